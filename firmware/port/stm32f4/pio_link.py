"""PlatformIO, before linking: build_flags do not reach the linker, and the platform would add start-up files."""

# ruff: noqa: F821
Import("env")
env.Replace(
    LINKFLAGS=[
        "-mthumb",
        "-mcpu=cortex-m4",
        *(flag for flag in env["CCFLAGS"] if str(flag).startswith(("-O", "-f", "-m"))),  # it compiles, with -flto
        "-nostartfiles",
        "--specs=nano.specs",
        "-Wl,--gc-sections,--fatal-warnings",
        "-Wl,-Map=${BUILD_DIR}/firmware.map",
        "-L${PROJECT_DIR}/firmware/port/stm32f4",
        "-Tsections.ld",
    ],
    LIBS=[library for library in env["LIBS"] if library != "stdc++"],
)
env.Depends("$BUILD_DIR/${PROGNAME}.elf", "$PROJECT_DIR/firmware/port/stm32f4/sections.ld")
