# Functions that install Debian's packages and fetch what the machine's Debian lacks. Source it after environment.sh.
mkdir -p "$CACHE_DIR"

say() { echo "${0##*/}: $*" >&2; }

as_root() {
  if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi
}

# Installs the Debian packages that a file lists.
install_packages() {
  local packages missing=()
  packages=$(sed 's/#.*//' "$1")
  for package in $packages; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  say "installing ${#missing[@]} Debian packages"
  as_root apt-get update -qq
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends \
    -o DPkg::Lock::Timeout=600 "${missing[@]}" > "$CACHE_DIR/apt.log" 2>&1 ||
    { tail -20 "$CACHE_DIR/apt.log" >&2; return 1; }
}

# Makes a folder `work` and sets `private`, the options of apt-get that fetch from a release of Debian with a private
# configuration, because the machine's configuration must not change. Takes the first of the machine's archives that has
# the release with Debian's signature, so that apt verifies what it fetches, whatever the mirror calls itself.
# Arguments: deb or deb-src, and the release's name.
prepare_debian() {
  local archive
  list_archives() { apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' | awk '!seen[$0]++'; }
  [ -n "$(list_archives)" ] || as_root apt-get update -qq
  work=$(mktemp -d "$CACHE_DIR/fetch.XXXXXX")
  mkdir -p "$work/lists/partial" "$work/sources.d" "$work/download"
  private=(-q -o "Dir::Etc::sourcelist=$work/sources.list" -o "Dir::Etc::sourceparts=$work/sources.d"
           -o "Dir::State::Lists=$work/lists" -o "Dir::Cache=$work" -o "APT::Sandbox::User=$(id -un)")
  for archive in $(list_archives); do
    echo "$1 [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $archive $2 main" > "$work/sources.list"
    ! apt-get "${private[@]}" update >> "$work/log" 2>&1 || return 0
  done
  say "none of apt's archives has Debian's $2; $work/log says why"
  return 1
}

# Fetches the source package $2 of Debian's release $1 into "$work/download"; further arguments go to apt-get.
fetch_source_package() {
  prepare_debian deb-src "$1" || return 1
  (cd "$work/download" && apt-get "${private[@]}" "${@:3}" source "$2" >> "$work/log" 2>&1) ||
    { cat "$work/log" >&2; return 1; }
}
