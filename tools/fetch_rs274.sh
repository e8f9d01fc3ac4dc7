#!/bin/sh
# Fetch LinuxCNC's stand-alone RS274/NGC interpreter into .tools/ without installing anything.
# It is the independent judge of the G-code reader (see tests/programs/test_gcode_rs274.py). Debian or Ubuntu only.
# LinuxCNC is GPL software: nothing of it is ever committed; .tools/ is ignored by git.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
into="$root/.tools/linuxcnc"
mkdir -p "$into/debs" "$into/root"
cd "$into/debs"
apt-get update -qq || true
# The interpreter needs these libraries and nothing of the real-time or graphical parts.
apt-get download linuxcnc-uspace libboost-python1.74.0 libpython3.11 libtirpc3
for optional in libedit2 libreadline8 libbsd0 libtirpc-common libudev1 libmodbus5 libglib2.0-0 libtinfo6; do
    apt-get download "$optional" || true
done
for deb in *.deb; do
    dpkg -x "$deb" "$into/root"
done
cat > "$root/.tools/rs274" <<'WRAPPER'
#!/bin/sh
here=$(cd "$(dirname "$0")" && pwd)/linuxcnc/root
arch=$(uname -m)-linux-gnu
LD_LIBRARY_PATH="$here/usr/lib:$here/usr/lib/$arch:$here/lib/$arch${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
export LD_LIBRARY_PATH
exec "$here/usr/bin/rs274" "$@"
WRAPPER
chmod +x "$root/.tools/rs274"
echo "fetched $root/.tools/rs274"
