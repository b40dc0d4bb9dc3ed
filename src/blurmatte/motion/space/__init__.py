"""Motion in three dimensions, on a plane and about a point, measured from one picture."""
