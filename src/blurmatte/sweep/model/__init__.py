"""Forward model of a streak: observation, path, silhouette, colors, and light on the plate."""
