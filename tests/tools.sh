#!/bin/sh
# Tools that some tests use and a bare machine lacks. As root they are installed, otherwise those tests are left out, and said so.
missing=""
for tool in clang cppcheck qemu-system-arm; do
    command -v "$tool" >/dev/null 2>&1 || missing="$missing $tool"
done
fuzzed='int LLVMFuzzerTestOneInput(void); int LLVMFuzzerTestOneInput(void) { return 0; }'
echo "$fuzzed" | clang -fsanitize=fuzzer -x c - -o /dev/null 2>/dev/null || missing="$missing libclang-rt-dev"
command -v arm-none-eabi-gcc >/dev/null 2>&1 || missing="$missing gcc-arm-none-eabi libnewlib-arm-none-eabi"
[ -z "$missing" ] && exit 0
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    DEBIAN_FRONTEND=noninteractive apt-get update -qq >/dev/null 2>&1
    # shellcheck disable=SC2086
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >/dev/null 2>&1 && exit 0
fi
echo "note: without$missing the tests of the second compiler, a part of the static analysis, the fuzzing of the device and the emulated board are left out (sudo apt install$missing)"
exit 0
