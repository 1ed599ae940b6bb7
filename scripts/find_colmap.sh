# Sets COLMAP to the program that it already names, else to the one built in this checkout, else to that of the Debian
# package (colmap-lazyloc), else to `colmap`. Source it from a script in this folder.
if [ -z "${COLMAP:-}" ]; then
  COLMAP=${BUILD_DIR:-$(realpath "$(dirname "${BASH_SOURCE[0]}")/..")/build}/bin/colmap
  [ -x "$COLMAP" ] || COLMAP=$(command -v colmap-lazyloc || echo colmap)
fi
export COLMAP
