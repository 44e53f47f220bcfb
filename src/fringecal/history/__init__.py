"""The history of a rig: an append-only store of records, control charts, drift, intervals and gauge studies."""
