#!/bin/sh
# Tools that some tests use and a bare machine lacks. As root they are installed, otherwise those tests are left out, and said so.
missing=""
left=""
for tool in clang cppcheck qemu-system-arm; do
    command -v "$tool" >/dev/null 2>&1 || missing="$missing $tool"
done
fuzzed='int LLVMFuzzerTestOneInput(void); int LLVMFuzzerTestOneInput(void) { return 0; }'
echo "$fuzzed" | clang -fsanitize=fuzzer -x c - -o /dev/null 2>/dev/null || missing="$missing libclang-rt-dev"
command -v arm-none-eabi-gcc >/dev/null 2>&1 || missing="$missing gcc-arm-none-eabi libnewlib-arm-none-eabi"
browser=""
command -v chromium >/dev/null 2>&1 || browser="chromium"
[ -z "$missing$browser" ] && exit 0
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    DEBIAN_FRONTEND=noninteractive apt-get update -qq >/dev/null 2>&1
    for wanted in "$missing" "$browser"; do  # apart: not every distribution packages a browser
        # shellcheck disable=SC2086
        [ -z "$wanted" ] || DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $wanted >/dev/null 2>&1 || left="$left $wanted"
    done
    [ -z "$left" ] && exit 0
else
    left="$missing $browser"
fi
echo "note: without$left the tests of the second compiler, a part of the static analysis, the fuzzing of the device, the emulated board and the scope's page are left out as far as they use them (sudo apt install$left)"
exit 0
