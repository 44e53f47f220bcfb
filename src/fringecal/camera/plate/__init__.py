"""The camera over the plate, fitted to one picture of a grid."""
