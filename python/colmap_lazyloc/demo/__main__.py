"""Renders the demo scene: see scene.py."""

import sys

from colmap_lazyloc.demo.scene import main

sys.exit(main())
