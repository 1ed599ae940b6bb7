"""hloc's localization without its 3D map: `localize_lazyloc` takes the place of `hloc.localize_sfm`."""
