#!/usr/bin/env bash
# prepare.sh FOLDER: an arm64 Debian 12 for the tests on a real kernel and in user-mode emulation.
# Everything is from Debian's packages and PyPI's wheels. i2c-stub, which Debian's arm64 kernel leaves out, is built
# from Debian's own source of that kernel.
set -euo pipefail
folder=$(realpath -m "$1")
here=$(cd "$(dirname "$0")/../.." && pwd)
python=${PYTHON:-python3}
as_root=$([ "$(id -u)" = 0 ] || echo sudo)
mkdir -p "$folder"
cd "$folder"

if [ ! -f ready ]; then
  $as_root apt-get update -q
  $as_root apt-get install -q -y --no-install-recommends qemu-system-arm qemu-user-static mmdebstrap cpio make xz-utils \
    gcc-aarch64-linux-gnu libc6-dev-arm64-cross linux-kbuild-6.1
  rm -rf root && mkdir root
  mmdebstrap --variant=extract --arch=arm64 --include=linux-image-arm64,linux-headers-arm64,busybox-static \
    --include=python3,python3-numpy,python3-yaml,python3-serial,python3-smbus2,python3-pytest,kmod,libstdc++6 \
    bookworm root.tar http://deb.debian.org/debian
  tar xf root.tar -C root && rm root.tar
  "$python" -m pip download -q --no-deps --python-version 3.11 --only-binary :all: -d wheels \
    --platform manylinux_2_34_aarch64 --platform manylinux2014_aarch64 --platform manylinux_2_17_aarch64 \
    'lgpio>=0.2.2' mcap lz4 zstandard
  for wheel in wheels/*.whl; do "$python" -m zipfile -e "$wheel" root/usr/lib/python3/dist-packages; done

  kernel=$(basename root/lib/modules/*)
  apt-get download -q linux-source-6.1 "linux-headers-${kernel%-arm64}-common"
  mkdir -p module tree/usr/lib
  dpkg-deb --fsys-tarfile linux-source-6.1_*.deb | tar xO ./usr/src/linux-source-6.1.tar.xz |
    tar xJ --wildcards --strip-components=3 -C module '*/drivers/i2c/i2c-stub.c'
  dpkg-deb -x "$(ls linux-headers-*-common_*.deb)" tree
  cp -a "root/usr/src/linux-headers-$kernel" tree/headers
  for part in scripts tools; do rm -f "tree/headers/$part" && ln -s "/usr/lib/linux-kbuild-6.1/$part" "tree/headers/$part"; done
  sed -i "s|/usr/src/|$folder/tree/usr/src/|g" tree/headers/Makefile
  ln -sfn /usr/lib/linux-kbuild-6.1 tree/usr/lib/linux-kbuild-6.1  # where the headers' own links lead
  echo 'obj-m := i2c-stub.o' > module/Makefile
  make -C tree/headers M="$folder/module" ARCH=arm64 CROSS_COMPILE=aarch64-linux-gnu- modules
  cp root/boot/vmlinuz-"$kernel" vmlinuz
  touch ready
fi

# what the guest needs of it, and the project as it stands
kernel=$(basename root/lib/modules/*)
rm -rf guest && mkdir -p guest/{bin,proc,sys,dev,tmp,modules,hopper}
mkdir -p guest/usr/lib/python3 guest/usr/bin
cp -a root/usr/lib/aarch64-linux-gnu guest/usr/lib/
cp -a root/lib guest/lib 2>/dev/null || true
rm -rf guest/lib/modules
rsync_python() { tar c -C root/usr/lib --exclude=test --exclude=tests --exclude=__pycache__ python3 python3.11 | tar x -C guest/usr/lib; }
rsync_python
cp root/usr/bin/python3.11 guest/usr/bin/
cp root/bin/busybox guest/bin/busybox
for module in i2c-dev softdog; do
  found=$(find "root/lib/modules/$kernel" -name "$module.ko*")
  case "$found" in *.xz) xz -dc "$found" > "guest/modules/$module.ko" ;; *) cp "$found" "guest/modules/" ;; esac
done
cp module/i2c-stub.ko guest/modules/
cp -r "$here"/{flight,hal,sim_hal,config} guest/hopper/
cp "$here"/tests/kernel/guest_checks.py guest/hopper/
cp "$here"/tests/kernel/guest_init.sh guest/init
chmod +x guest/init
(cd guest && find . | cpio -o -H newc -R 0:0 --quiet | gzip -1) > initramfs.gz
