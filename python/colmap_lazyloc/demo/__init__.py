"""Renders a courtyard whose poses and intrinsics are known exactly; needs opencv, pycolmap and scipy."""
