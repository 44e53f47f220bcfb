"""What a virtual rig is: camera, projector, light, noise, and what is true of it."""
