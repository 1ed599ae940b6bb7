# Functions that install Debian's packages and fetch what the machine's Debian lacks. Source it after environment.sh.
mkdir -p "$CACHE_DIR"

say() { echo "${0##*/}: $*" >&2; }

as_root() {
  if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi
}

# Runs a command whose output goes to the log $1. While it runs, says every 30 seconds how far it is: the function $2 prints
# this.
with_progress() {
  local log=$1 count=$2 reporter code=0
  shift 2
  (while sleep 30 2> /dev/null && kill -0 $$; do say "$("$count")"; done) < /dev/null > /dev/null &
  reporter=$!
  "$@" >> "$log" 2>&1 || code=$?
  kill "$reporter"
  wait "$reporter" 2> /dev/null || true
  return $code
}

# Prints how far a step is: "$1: $2 of $3 $4, N %". $2 may exceed $3, because it is counted in another program's output.
share() {
  local num_done=$(($2 < $3 ? $2 : $3))
  echo "$1: $num_done of $3 $4, $((100 * num_done / ($3 > 0 ? $3 : 1))) %"
}

# Prints how far a build of ninja is by its last line in the log $2. $1: what is built.
share_of_build() {
  local counts
  counts=$(sed -n 's|^ *\[\([0-9]*\)/\([0-9]*\)\].*|\1 \2|p' "$2" | tail -1)
  counts=${counts:-0 0}
  share "building $1" "${counts% *}" "${counts#* }" "steps"
}

# Installs the Debian packages that a file lists.
install_packages() {
  local packages missing=() num_new log=$CACHE_DIR/apt.log
  packages=$(sed 's/#.*//' "$1")
  for package in $packages; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  say "installing ${#missing[@]} Debian packages"
  as_root apt-get update -qq
  num_new=$(apt-get install -s --no-install-recommends "${missing[@]}" 2> /dev/null | grep -c '^Inst' || true)
  # Each is downloaded, unpacked and set up.
  share_of_packages() {
    share "installing Debian packages" "$(grep -cE '^(Get:|Unpacking|Setting up)' "$log")" $((3 * num_new)) "steps"
  }
  : > "$log"
  with_progress "$log" share_of_packages as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q \
    --no-install-recommends -o DPkg::Lock::Timeout=600 "${missing[@]}" || { tail -20 "$log" >&2; return 1; }
}

# Makes a folder `work` and sets `private`, the options of apt-get that fetch from a release of Debian with a private
# configuration, because the machine's configuration must not change. Takes the first of the machine's archives that has
# the release with Debian's signature, so that apt verifies what it fetches, whatever the mirror calls itself. The last is
# DEBIAN_ARCHIVE, for Ubuntu, whose apt has no archive of Debian.
# Arguments: deb or deb-src, and the release's name.
prepare_debian() {
  local archive
  list_archives() { apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' | awk '!seen[$0]++'; }
  [ -n "$(list_archives)" ] || as_root apt-get update -qq
  work=$(mktemp -d "$CACHE_DIR/fetch.XXXXXX")
  mkdir -p "$work/lists/partial" "$work/sources.d" "$work/download"
  private=(-q -o "Dir::Etc::sourcelist=$work/sources.list" -o "Dir::Etc::sourceparts=$work/sources.d"
           -o "Dir::State::Lists=$work/lists" -o "Dir::Cache=$work" -o "APT::Sandbox::User=$(id -un)")
  for archive in $(list_archives) ${DEBIAN_ARCHIVE:-}; do
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
