#!/usr/bin/env bash
# Writes both packages side by side, where catkin_pkg, rosdep, bloom and colcon look for packages.
#   tools/release_tree.sh PYTHON DIR
# DIR/aircraft_sysid_ros is what a source distribution holds, with the message definitions that the program reads;
# DIR/aircraft_sysid_msgs is the package of messages, which stands alone.
set -euo pipefail
cd "$(dirname "$0")/.."
python=$1
target=$2
ros=$target/aircraft_sysid_ros
messages=$target/aircraft_sysid_msgs

for folder in "$ros" "$messages"; do
    if [ -e "$folder" ]; then
        echo "make release-tree: $folder is already there: remove it, or give another DIR" >&2
        exit 1
    fi
done

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"$python" setup.py --quiet egg_info --egg-base "$scratch"
mkdir -p "$ros" "$messages"
grep -v -e '\.egg-info/' -e '^msg_defs/[^/]*$' -e '^msg_defs/srv/' -e '^tools/' -e '^MANIFEST.in$' "$scratch"/*.egg-info/SOURCES.txt |
    tar -c -T - | tar -x -C "$ros"
tar -c LICENSE -C msg_defs . | tar -x -C "$messages"
