"""What lies under a virtual rig."""
