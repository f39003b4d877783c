"""The command line `warpgrasp`: one function a command."""
