"""Reading and writing of all file formats: pictures, layers, solutions, models and calibrations."""
