"""What the bare plate looks like to the camera, kept for later captures."""
