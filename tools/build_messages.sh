#!/usr/bin/env bash
# Builds aircraft_sysid_msgs against the ROS wheels of a virtual environment and installs it there,
# where the wheels' bootstrapper makes every process find its libraries.
#   tools/build_messages.sh VENV BUILD_FOLDER
set -euo pipefail
source_folder=$(cd "$(dirname "$0")/../msg_defs" && pwd)
prefix=$(cd "$1" && pwd)
build=$2
log=$build/build.log

# A configuration of another environment or a removed message would leave stale files behind.
rm -rf "$build" "$prefix"/share/aircraft_sysid_msgs "$prefix"/include/aircraft_sysid_msgs \
    "$prefix"/lib/libaircraft_sysid_msgs__* "$prefix"/lib/python3*/site-packages/aircraft_sysid_msgs*
mkdir -p "$build"

export PATH="$prefix/bin:$PATH" AMENT_PREFIX_PATH="$prefix" CMAKE_PREFIX_PATH="$prefix"
run() {
    "$@" >>"$log" 2>&1 || {
        tail -n 40 "$log" >&2
        echo "make env: building the messages failed; the whole log is $log" >&2
        exit 1
    }
}
run cmake -S "$source_folder" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF \
    -DCMAKE_INSTALL_PREFIX="$prefix" -DPython3_EXECUTABLE="$prefix/bin/python"
run cmake --build "$build"
run cmake --install "$build"
"$prefix/bin/python" -c 'import rclpy; from rclpy.type_support import check_for_type_support as check
from aircraft_sysid_msgs import msg, srv
check(msg.AirData), check(srv.Reset)' ||
    { echo "make env: the messages were built but do not import" >&2; exit 1; }
