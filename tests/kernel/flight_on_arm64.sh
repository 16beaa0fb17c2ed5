#!/usr/bin/env bash
# flight_on_arm64.sh FOLDER: flight and hal from a wheel, and the flight tests, on the arm64 Debian that prepare.sh made,
# in QEMU's user-mode emulation. The simulated robot and SciPy are not on board, so tests that need them are left out.
set -euo pipefail
folder=$(realpath -m "$1")
here=$(cd "$(dirname "$0")/../.." && pwd)
python=${PYTHON:-python3}
site=$folder/onboard
rm -rf "$site" && mkdir -p "$site"
"$python" -m build --quiet --wheel --no-isolation --outdir "$site" "$here"
"$python" -m zipfile -e "$site"/hopper_flight-*.whl "$site/wheel"
# what flies, and nothing else: neither simulation nor ground tools
mv "$site"/wheel/{flight,hal,hopper_flight-*.dist-info} "$site/" && rm -rf "$site/wheel"
"$python" -m pip download -q --no-deps --only-binary :all: --dest "$site/pure" hypothesis==6.100.0 sortedcontainers attrs
for wheel in "$site"/pure/*.whl; do "$python" -m zipfile -e "$wheel" "$site"; done
mkdir -p "$site/tests" && cp "$here"/tests/flight/*.py "$here"/tests/log/*.py "$site/tests/"
cd "$site/tests"
mapfile -t simulated < <(grep -lE '^(from|import) (sim_hal|ground|scipy)|from flight_fakes|from two_mass' ./*.py || true)
rm -f "${simulated[@]}"
# the packages were unpacked, not installed: nobody has chosen a BLAS yet
libraries=/usr/lib/aarch64-linux-gnu
arm64_python() {
  PYTHONPATH=$site:$folder/root/usr/lib/python3/dist-packages PYTHONDONTWRITEBYTECODE=1 \
    qemu-aarch64-static -L "$folder/root" -E LD_LIBRARY_PATH="$libraries/blas:$libraries/lapack" \
    "$folder/root/usr/bin/python3.11" "$@"
}
arm64_python -c 'import platform; print(platform.machine(), platform.python_version(), *platform.libc_ver())'
arm64_python -m pytest -q -p no:cacheprovider -o addopts= .  # no tests at once: one emulated processor
