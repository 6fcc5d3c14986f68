#!/usr/bin/env bash
# Lays out Embree 4 in DIR, for machines whose distribution has only Embree 3:
#
#     ffi/embree4-from-wheel.sh DIR
#     EMBREE_DIR=DIR cargo test --features embree4-sys
#
# The library comes from the Python wheel embreex, the headers (of 4.2, which serve any 4.x: embree.c leaves room for
# what later versions appended) from the crate embree4-sys.
set -euo pipefail
cd "$(dirname "$0")/.."

WHEEL=embreex==4.4.0.post1
CRATE=embree4-sys

dir=${1:?usage: ffi/embree4-from-wheel.sh DIR}
if [ -e "$dir/lib/libembree4.so" ] && [ -e "$dir/include/embree4/rtcore.h" ]; then
    exit 0
fi

# Installs the named Debian packages where there is apt-get, as root or through sudo.
install() {
    as_root=
    [ "$(id -u)" = 0 ] || as_root=sudo
    echo "installing $* with apt-get"
    $as_root apt-get update -qq
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}
python3 -m pip --version >/dev/null 2>&1 || install python3 python3-pip

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
python3 -m pip download --quiet --disable-pip-version-check --no-deps --only-binary=:all: --dest "$scratch" "$WHEEL"
python3 -m zipfile -e "$scratch"/embreex-*.whl "$scratch/wheel"

cargo fetch --quiet
headers=$(cargo metadata --format-version 1 --all-features | python3 -c "
import json, os, sys
packages = json.load(sys.stdin)['packages']
manifest = next(p['manifest_path'] for p in packages if p['name'] == '$CRATE')
print(os.path.join(os.path.dirname(manifest), 'lib', 'embree4'))")

mkdir -p "$dir/include" "$dir/lib"
cp -R "$headers" "$dir/include/"
# The wheel's file names are the libraries' own names: libembree4 finds its TBB beside itself.
cp "$scratch"/wheel/embreex.libs/*.so* "$dir/lib/"
library=$(basename "$dir"/lib/libembree4-*.so.4)
ln -sf "$library" "$dir/lib/libembree4.so.4"
ln -sf "$library" "$dir/lib/libembree4.so"
echo "Embree 4 is in $dir"
