"""What the commands do that need no study: fits of points, models to recognize by, the robot as a
file, checks of the installation."""
