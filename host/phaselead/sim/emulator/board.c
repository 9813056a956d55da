/* The plugin itself: maps the parts when the processor exists, and resets them with it. */
#include "board.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

EXPORT int qemu_plugin_version = 1;
EXPORT int qemu_plugin_install(qemu_plugin_id_t id, const struct qemu_info *info, int argc, char **argv);

#define OVERLAY_PRIORITY 10
#define RCC_CR_AT_RESET 0x83u
#define NOT_THIS_QEMU 71
#define BROKEN 70

struct board board;
static Object *processor;
static MemoryRegion hole_flash, hole_ccm, hole_sram, dwt;

int64_t now_ns(void)
{
    return qemu_clock_get_ns(CLOCK_VIRTUAL);
}

void board_broken(const char *format, ...)
{
    char text[256];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    fprintf(stderr, "emulated board: %s\n", text);
    world_say_broken(text);
    _Exit(BROKEN);
}

void board_map(MemoryRegion *region, const MemoryRegionOps *ops, const char *name, uint64_t address, uint64_t size)
{
    memory_region_init_io(region, NULL, ops, NULL, name, size);
    memory_region_add_subregion_overlap(get_system_memory(), address, region, OVERLAY_PRIORITY);
}

void board_irq(int number, bool level)
{
    qemu_set_irq(qdev_get_gpio_in(processor, number), level);
}

void board_nmi(void)
{
    qemu_irq nmi = qdev_get_gpio_in_named(processor, "NMI", 0);
    qemu_set_irq(nmi, 1);
    qemu_set_irq(nmi, 0);
}

static MemTxResult nothing_there(void *opaque, uint64_t offset, uint64_t *value, unsigned size, uint32_t attrs)
{
    (void)opaque, (void)offset, (void)value, (void)size, (void)attrs;
    return MEMTX_DECODE_ERROR;
}

static MemTxResult nothing_to_write(void *opaque, uint64_t offset, uint64_t value, unsigned size, uint32_t attrs)
{
    (void)opaque, (void)offset, (void)value, (void)size, (void)attrs;
    return MEMTX_DECODE_ERROR;
}

static uint64_t dwt_read(void *opaque, uint64_t offset, unsigned size)
{
    (void)opaque, (void)size;
    return offset == 4 ? (uint32_t)((unsigned __int128)now_ns() * rcc_sysclk_Hz() / 1000000000u) : 0x40000001u;
}

static void dwt_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    (void)opaque, (void)offset, (void)value, (void)size;
}

/* Memory that QEMU's board has and the chip has not: CCM and the upper flash on the F446, a third SRAM on both. */
static void map_holes(void)
{
    static const MemoryRegionOps hole = {.read_with_attrs = nothing_there,
                                         .write_with_attrs = nothing_to_write,
                                         .endianness = LITTLE_ENDIAN_DEVICE,
                                         .valid = {1, 4, false, NULL}};
    if (board.f446) {
        board_map(&hole_flash, &hole, "no flash", 0x08080000, 0x80000);
        board_map(&hole_ccm, &hole, "no ccm", 0x10000000, 0x10000);
    }
    board_map(&hole_sram, &hole, "no sram", 0x20020000, 0x10000);
}

/* The counter is in the processor's own memory, not the system's. */
static void map_dwt(void)
{
    static const MemoryRegionOps ops = {
        .read = dwt_read, .write = dwt_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {4, 4, false, NULL}};
    Object *cpu = object_resolve_path_type("", "cortex-m4-arm-cpu", NULL);
    MemoryRegion *own = cpu ? (MemoryRegion *)object_property_get_link(cpu, "memory", NULL) : NULL;
    if (!own)
        return;
    memory_region_init_io(&dwt, NULL, &ops, NULL, "dwt", 0x400);
    memory_region_add_subregion_overlap(own, 0xE0001000, &dwt, OVERLAY_PRIORITY);
}

/* What was declared by hand must work: a register read through QEMU must come from the model. */
static void check_fit(void)
{
    uint32_t rcc_cr = 0;
    cpu_physical_memory_rw(0x40023800, &rcc_cr, sizeof rcc_cr, false);
    if (rcc_cr != RCC_CR_AT_RESET) {
        fprintf(stderr, "emulated board: this QEMU does not take the models; 7.2 does\n");
        _Exit(NOT_THIS_QEMU);
    }
}

static void reset(void *opaque)
{
    static bool on;
    (void)opaque;
    inject_reset();
    rcc_reset();
    timer_reset();
    gpio_reset();
    converters_reset();
    exti_reset();
    line_reset();
    flash_reset();
    crc_reset();
    watchdog_reset();
    if (!on) { /* switched on: QEMU resets everything once */
        check_fit();
        world_start();
    }
    on = true;
}

static void make(qemu_plugin_id_t id, unsigned vcpu)
{
    (void)id;
    processor = object_resolve_path_type("", "armv7m", NULL);
    if (vcpu != 0)
        return;
    if (!processor) {
        fprintf(stderr, "emulated board: this QEMU has no armv7m; 7.2 has\n");
        _Exit(NOT_THIS_QEMU);
    }
    rcc_map();
    timer_map();
    gpio_map();
    converters_map();
    exti_map();
    line_map();
    flash_map();
    crc_map();
    watchdog_map();
    map_holes();
    map_dwt();
    rcc_reset_by(RESET_POWER_ON);
    converters_power_on();
    qemu_register_reset(reset, NULL);
}

int qemu_plugin_install(qemu_plugin_id_t id, const struct qemu_info *info, int argc, char **argv)
{
    int in = -1, out = -1;
    const char *library = NULL;
    (void)info;
    for (int i = 0; i < argc; i++) {
        if (strncmp(argv[i], "in=", 3) == 0)
            in = (int)strtol(argv[i] + 3, NULL, 10);
        else if (strncmp(argv[i], "out=", 4) == 0)
            out = (int)strtol(argv[i] + 4, NULL, 10);
        else if (strncmp(argv[i], "library=", 8) == 0)
            library = argv[i] + 8;
        else if (strcmp(argv[i], "delays=1") == 0)
            board.delays = true;
        else if (strcmp(argv[i], "chip=F446") == 0)
            board.f446 = true;
        else if (strncmp(argv[i], "usart=", 6) == 0)
            board.usart = (unsigned)strtoul(argv[i] + 6, NULL, 10);
        else if (strncmp(argv[i], "count=", 6) == 0)
            count_open(id, argv[i] + 6);
    }
    if (board.usart < 1 || board.usart > 2 || !library || !world_open(in, out, library))
        return -1;
    qemu_plugin_register_vcpu_init_cb(id, make);
    return 0;
}
