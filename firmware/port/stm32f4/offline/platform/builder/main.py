"""Builds a bare-metal program as platform-ststm32 does; uploads with the system's openocd."""

from os.path import join

from SCons.Script import AlwaysBuild, Builder, Default, DefaultEnvironment

env = DefaultEnvironment()
cpu = env.BoardConfig().get("build.cpu")
env.Replace(
    AR="arm-none-eabi-gcc-ar",
    AS="arm-none-eabi-as",
    CC="arm-none-eabi-gcc",
    CXX="arm-none-eabi-g++",
    OBJCOPY="arm-none-eabi-objcopy",
    RANLIB="arm-none-eabi-gcc-ranlib",
    SIZETOOL="arm-none-eabi-size",
    ARFLAGS=["rc"],
    SIZEPROGREGEXP=r"^(?:\.text|\.data|\.rodata|\.text.align|\.ARM.exidx)\s+(\d+).*",
    SIZEDATAREGEXP=r"^(?:\.data|\.bss|\.noinit)\s+(\d+).*",
    SIZECHECKCMD="$SIZETOOL -A -d $SOURCES",
    SIZEPRINTCMD="$SIZETOOL -B -d $SOURCES",
    PROGNAME="firmware",
    PROGSUFFIX=".elf",
)
env.Append(
    ASFLAGS=["-mthumb", f"-mcpu={cpu}"],
    CCFLAGS=["-Os", "-ffunction-sections", "-fdata-sections", "-Wall", "-mthumb", f"-mcpu={cpu}"],
    CPPDEFINES=[("F_CPU", "$BOARD_F_CPU")],
    LINKFLAGS=["-Os", "-Wl,--gc-sections,--relax", "-mthumb", f"-mcpu={cpu}"],
    LIBS=["c", "gcc", "m", "stdc++"],
    BUILDERS={"ElfToBin": Builder(action="$OBJCOPY -O binary $SOURCES $TARGET", suffix=".bin")},
)

elf = env.BuildProgram()
binary = env.ElfToBin(join("$BUILD_DIR", "${PROGNAME}"), elf)
env.Depends(binary, "checkprogsize")
AlwaysBuild(env.Alias("size", elf, env.VerboseAction("$SIZEPRINTCMD", "Calculating size $SOURCE")))
program = "openocd -f interface/stlink.cfg -f target/stm32f4x.cfg -c 'program {$SOURCE} verify reset exit'"
AlwaysBuild(env.Alias("upload", elf, env.VerboseAction(program, "Uploading $SOURCE")))
Default([env.Alias("buildprog", binary, binary), "size"])
