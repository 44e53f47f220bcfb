"""The command line: each verb loads, calls one procedure, saves and prints."""
