"""What a session states of fringes that count a projector's pixels: frames along its axes, and phase maps."""
