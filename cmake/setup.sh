# What experiments/reproduce and tests/run share: packages, configuring, building. Sourced, never run.
# shellcheck shell=bash

palpate_root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"

say() { printf '%s\n' "$*"; }
fail() {
  printf 'error: %s\n' "$*" >&2
  exit 1
}

# The packages of the given stages that dpkg does not know as installed, one a line.
missing_packages() {
  local stages=" $* " name stage rest installed
  local -a wanted=()
  while read -r name stage rest; do
    [[ -z $name || $name == \#* ]] && continue
    [[ $stages == *" $stage "* ]] && wanted+=("$name")
  done <"$palpate_root/cmake/packages.txt"
  # dpkg-query exits with 1 when it does not know a name: that is an answer here.
  installed="$(dpkg-query -W -f '${db:Status-Abbrev}${Package}\n' "${wanted[@]}" 2>/dev/null || true)"
  for name in "${wanted[@]}"; do
    grep -qxF "ii $name" <<<"$installed" || say "$name"
  done
}

# Installs what is missing for the given stages. Sets packages_changed=1 where it installed something.
packages_changed="${packages_changed:-0}"
install_packages() {
  if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
    say "This is not Debian: the packages of cmake/packages.txt are taken to be there under their names here."
    return 0
  fi
  local -a missing=() as_root=()
  mapfile -t missing < <(missing_packages "$@")
  ((${#missing[@]})) || return 0
  if [[ $(id -u) != 0 ]]; then
    command -v sudo >/dev/null ||
      fail "missing packages, and neither root nor sudo to install them: apt-get install ${missing[*]}"
    as_root=(sudo)
    say "Palpate needs ${#missing[@]} Debian packages that are missing. It now runs, with sudo (which may ask for your password):"
  else
    say "Palpate needs ${#missing[@]} Debian packages that are missing. It now runs:"
  fi
  say "  apt-get update"
  say "  apt-get install --no-install-recommends ${missing[*]}"
  "${as_root[@]}" apt-get -qq update
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends "${missing[@]}" </dev/null
  packages_changed=1
}

# Compilers running at once: one a core, and no more than memory allows (a unit with CGAL or PCL takes about 1.5 GB).
# PALPATE_JOBS overrides it.
build_jobs() {
  local jobs available_kb by_memory
  if [[ -n ${PALPATE_JOBS:-} ]]; then
    say "$PALPATE_JOBS"
    return 0
  fi
  jobs="$(nproc)"
  available_kb="$(awk '/^MemAvailable:/ { print $2 }' /proc/meminfo 2>/dev/null || true)"
  by_memory=$((${available_kb:-0} / 1500000))
  ((by_memory >= 1 && by_memory < jobs)) && jobs=$by_memory
  say "$jobs"
}

# configure PRESET [-DKEY=VALUE ...]: runs CMake where there is no build yet, where the presets or the given settings
# changed, or where packages came. Everything else ninja notices by itself.
configure() {
  local preset=$1 folder="$palpate_root/build/$1" stamp settings
  shift
  stamp="$folder/.configured"
  settings="$* $(cksum <"$palpate_root/CMakePresets.json")"
  if [[ $packages_changed == 0 && -f $folder/build.ninja && -f $stamp && "$(<"$stamp")" == "$settings" ]]; then
    return 0
  fi
  (cd "$palpate_root" && cmake --preset "$preset" "$@")
  printf '%s\n' "$settings" >"$stamp"
}

# build PRESET [TARGET ...]: all targets where none is named.
build() {
  local preset=$1
  shift
  (cd "$palpate_root" && cmake --build --preset "$preset" --parallel "$(build_jobs)" ${1:+--target "$@"})
}
