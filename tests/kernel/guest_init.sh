#!/bin/busybox sh
# First program of the emulated computer: modules in, checks, power off.
/bin/busybox mount -t proc proc /proc
/bin/busybox mount -t sysfs sysfs /sys
/bin/busybox mount -t devtmpfs devtmpfs /dev
/bin/busybox mkdir -p /dev/pts && /bin/busybox mount -t devpts devpts /dev/pts
/bin/busybox insmod /modules/i2c-dev.ko
/bin/busybox insmod /modules/i2c-stub.ko chip_addr=0x6a,0x40,0x48
/bin/busybox insmod /modules/softdog.ko
echo "kernel: $(/bin/busybox uname -srm)"
cd /hopper && PYTHONDONTWRITEBYTECODE=1 PYTHONPATH=/hopper /usr/bin/python3.11 guest_checks.py
echo "checks ended with code $?"
/bin/busybox poweroff -f
