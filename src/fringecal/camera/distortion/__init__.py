"""The distortion test, the thesis's scale tables, and what they rest on."""
