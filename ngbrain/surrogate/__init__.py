"""Property maps from displacements in hundredths of a second: a wavelet neural operator, its data and its training."""
