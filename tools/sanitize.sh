#!/usr/bin/env bash
# The core under sanitizers: tools/sanitize.sh address|thread [arguments of pytest]
#
#   address  AddressSanitizer and UndefinedBehaviorSanitizer with float-cast-overflow
#   thread   ThreadSanitizer with archer, which knows what the threads of LLVM's libomp wait for;
#            it cannot see through libgomp
#
# Both need clang (Debian: clang libomp-dev).
#
# First planted faults have to be reported; the argument "planted" ends there. Then the core is
# built into build/sanitize, with the kernels that every processor has, and tests have to pass
# without a report. PYTHON names an interpreter that has the packages of the extra "test", pybind11,
# cmake and ninja.
set -euo pipefail
cd "$(dirname "$0")/.."
kind=${1:?address or thread}
shift
PYTHON=$(command -v "${PYTHON:-python3}")
PATH="$(dirname "$PYTHON"):$PATH"
[ $# -gt 0 ] || set -- tests/core tests/engine tests/run tests/view/test_pictures.py tests/base/test_odd_values.py
folder=$PWD/build/sanitize/$kind

mkdir -p "$folder/bin"
case $kind in
  address)
    # ASan itself sees what the checks null and object-size look for.
    flags="-fsanitize=address,undefined,float-cast-overflow -fno-sanitize=null,object-size,vptr,function -fno-sanitize-recover=all"
    export ASAN_OPTIONS=detect_leaks=0:allocator_may_return_null=1 UBSAN_OPTIONS=print_stacktrace=1
    faults="heap_overflow float_cast" ;;
  thread)
    flags="-fsanitize=thread"
    # Python and NumPy are not instrumented: only accesses of the core count.
    # Tests leave daemon threads at the end of a process, which is no report.
    export TSAN_OPTIONS=ignore_noninstrumented_modules=1:report_thread_leaks=0:exitcode=66 OMP_TOOL_LIBRARIES=libarcher.so
    faults="race" ;;
  *) echo "address or thread, got $kind"; exit 2 ;;
esac
LD_LIBRARY_PATH=$(dirname "$(readlink -f "$(command -v clang++)")")/../lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
export LD_LIBRARY_PATH
# An interpreter that has the runtime in it: preloaded, that of TSan fails. It needs the shared
# library of Python.
read -r library version home < <("$PYTHON" -c \
  "import sys, sysconfig as s; print(s.get_config_var('LIBDIR'), s.get_config_var('LDVERSION'), sys.base_prefix)")
echo "home = $home/bin" > "$folder/pyvenv.cfg"
# shellcheck disable=SC2086
echo 'extern "C" int Py_BytesMain(int, char**); int main(int n, char** a) { return Py_BytesMain(n, a); }' \
  | clang++ $flags -x c++ - -o "$folder/bin/python" -L"$library" -lpython"$version" -Wl,-rpath,"$library"

# shellcheck disable=SC2086
clang++ -O0 -g1 -fopenmp $flags -shared -fPIC tools/planted_faults.cpp -o "$folder/planted_faults.so"
planted() {
  "$folder/bin/python" -c "import ctypes; ctypes.CDLL('$folder/planted_faults.so').$1()" > "$folder.fault" 2>&1
}
planted none || { echo "a sound loop of OpenMP is reported:"; tail -n 30 "$folder.fault"; exit 1; }
for fault in $faults; do
  ! planted "$fault" || { echo "the planted fault $fault is not seen"; exit 1; }
  grep -Eo "(AddressSanitizer|runtime error|ThreadSanitizer): .*" "$folder.fault" | head -n 1 | sed "s/^/planted $fault is seen: /"
done

[ "$1" != planted ] || exit 0

# The bare name makes CMake precompile no header.
launcher=$(command -v ccache > /dev/null && echo ccache || true)
cmake -G Ninja -S . -B "$folder" -DSKBUILD_PROJECT_VERSION=0 -DSKBUILD_PROJECT_VERSION_FULL=0 -DCMAKE_BUILD_TYPE=Sanitize \
  -DCMAKE_CXX_COMPILER=clang++ -DCMAKE_CXX_FLAGS="-O1 -g1 -fno-omit-frame-pointer $flags" -DCLOTHSIM_PORTABLE=ON \
  -DCMAKE_CXX_COMPILER_LAUNCHER="$launcher" -DPython_EXECUTABLE="$PYTHON" -Dpybind11_DIR="$("$PYTHON" -m pybind11 --cmakedir)" \
  > "$folder.log" 2>&1 || { tail -n 30 "$folder.log"; exit 1; }
cmake --build "$folder" -j 2 >> "$folder.log" 2>&1 || { tail -n 30 "$folder.log"; exit 1; }
rm -rf "$folder/python"
cp -r python "$folder/python"
rm -f "$folder"/python/clothsim/_core*.so
cp "$folder"/_core*.so "$folder/python/clothsim/"

PYTHONPATH=$folder/python:$("$PYTHON" -c "import sysconfig; print(sysconfig.get_path('purelib'))")
export PYTHONPATH CLOTHSIM_TEST_SANITIZER="$kind"
"$folder/bin/python" -m pytest -q -p no:cacheprovider "$@"
