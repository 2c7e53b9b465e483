"""Camera paths: the spline, generators of random paths, frame times, TUM files."""
