"""PlatformIO, the programs: the image for slot A with what a debugger writes beside it, that for slot B, and both in
one file for an update over the wire.

build_flags do not reach the linker, and the platform would add start-up files.
"""

# ruff: noqa: F821
import runpy
from pathlib import Path

Import("env")
project = Path(env.subst("$PROJECT_DIR"))
port = project / "firmware" / "port" / "stm32f4"
tools = runpy.run_path(str(port / "images.py"))
build_id = runpy.run_path(str(project / "firmware" / "build_id.py"))["build_id"](project)
SLOT_A, SLOT_B = "0x08020000", "0x08040000"
BOOTLOADER = ["app/boot_record.c", "app/crc32.c", "app/flash_port.c", "app/image.c"]


def link_flags(script, map_file, *more):
    return [
        "-mthumb",
        "-mcpu=cortex-m4",
        *(flag for flag in env["CCFLAGS"] if str(flag).startswith(("-O", "-f", "-m"))),  # it compiles, with -flto
        "-nostartfiles",
        "--specs=nano.specs",
        "-Wl,--gc-sections,--fatal-warnings",
        f"-Wl,-Map=${{BUILD_DIR}}/{map_file}",
        *more,
        f"-L{port}",
        f"-T{script}",
    ]


def image_flags(slot, map_file):
    return link_flags(port / "sections.ld", map_file, f"-Wl,--defsym=image_begin={slot}")


def finish(target, source, env):
    for elf in target:
        tools["finish"](Path(str(elf)), build_id)


def bundle(target, source, env):
    tools["bundle"]([Path(str(elf)) for elf in source], Path(str(target[0])))


env.Replace(LIBS=[library for library in env["LIBS"] if library != "stdc++"])
small = [f for f in env["CCFLAGS"] if not str(f).startswith(("-flto", "-fstack-usage", "-fcallgraph", "-O", "-mslow"))]

boot = env.Clone(CCFLAGS=[*small, "-O2"])  # -Os leaves the CRC over the image rolled up, and a start 0.4 ms later
sources = [*(project / "firmware" / name for name in BOOTLOADER), port / "bootloader/bootloader.c"]
sources.append(port / "bootloader/record_flash.c")
objects = [boot.Object(f"$BUILD_DIR/bootloader/{path.stem}.o", str(path)) for path in sources]
boot.Replace(LINKFLAGS=link_flags(port / "bootloader/bootloader.ld", "bootloader.map"))
loader = boot.Program("$BUILD_DIR/bootloader.elf", objects)
boot.Depends(loader, str(port / "bootloader/bootloader.ld"))
binary = boot.Command("$BUILD_DIR/bootloader.bin", loader, "$OBJCOPY -O binary $SOURCE $TARGET")

beside = env.Clone(CCFLAGS=[*small, "-Os"])
beside.Append(CPPDEFINES=[("BOOTLOADER_BINARY", f'\\"{env.subst("$BUILD_DIR")}/bootloader.bin\\"')])
for_debugger = beside.Object("$BUILD_DIR/bootloader/for_debugger.o", str(port / "bootloader/for_debugger.c"))
beside.Depends(for_debugger, binary)

other = env.Clone(LINKFLAGS=image_flags(SLOT_B, "firmware_b.map"))
image_b = other.Program("$BUILD_DIR/firmware_b.elf", env["PIOBUILDFILES"])
env.Replace(LINKFLAGS=[*image_flags(SLOT_A, "firmware.map"), "$BUILD_DIR/bootloader/for_debugger.o"])
image_a = "$BUILD_DIR/${PROGNAME}.elf"
env.Depends(image_a, for_debugger)
env.Depends([image_a, image_b], [str(port / "sections.ld"), str(port / "images.py")])
for elf in (image_a, image_b):
    env.AddPostAction(elf, finish)
both = env.Command("$BUILD_DIR/update.bin", [image_a, image_b], bundle)
env.Depends(env.Alias("buildprog"), both)
