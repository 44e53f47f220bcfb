"""Which fringe of the projector a surface shows: evidence along epipolar lines, plate, known heights, periods."""
