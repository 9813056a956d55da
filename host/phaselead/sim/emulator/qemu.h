/* What the model uses of QEMU 7.2: its plugin interface, and functions that the program exports. No header of either is
 * packaged, so both are declared here by hand; board.c checks at start that they fit.
 */
#ifndef PHASELEAD_EMULATOR_QEMU_H
#define PHASELEAD_EMULATOR_QEMU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define EXPORT __attribute__((visibility("default")))

/* ---------------------------------------------------------------- include/qemu/qemu-plugin.h, version 1 */
typedef uint64_t qemu_plugin_id_t;
struct qemu_info;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
typedef void vcpu_callback(qemu_plugin_id_t id, unsigned vcpu);
typedef void insn_callback(unsigned vcpu, void *data);
void qemu_plugin_register_vcpu_init_cb(qemu_plugin_id_t id, vcpu_callback *callback);
void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t id,
                                           void (*callback)(qemu_plugin_id_t, struct qemu_plugin_tb *));
void qemu_plugin_register_vcpu_insn_exec_cb(struct qemu_plugin_insn *insn, insn_callback *callback, int flags,
                                            void *data);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *tb);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *tb, size_t index);
uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *insn);
size_t qemu_plugin_insn_size(const struct qemu_plugin_insn *insn);
const void *qemu_plugin_insn_data(const struct qemu_plugin_insn *insn);
typedef void access_callback(unsigned vcpu, uint32_t info, uint64_t address, void *data);
void qemu_plugin_register_vcpu_mem_cb(struct qemu_plugin_insn *insn, access_callback *callback, int flags, int accesses,
                                      void *data);
bool qemu_plugin_mem_is_store(uint32_t info);
#define PLUGIN_NO_REGISTERS 0
#define PLUGIN_READ_AND_WRITE 3

/* ---------------------------------------------------------------- memory */
typedef struct {
    _Alignas(16) char opaque[4096]; /* larger than any version's */
} MemoryRegion;
typedef struct Object Object;
typedef int MemTxResult;
#define MEMTX_OK 0
#define MEMTX_DECODE_ERROR 2
typedef struct {
    uint64_t (*read)(void *opaque, uint64_t offset, unsigned size);
    void (*write)(void *opaque, uint64_t offset, uint64_t value, unsigned size);
    MemTxResult (*read_with_attrs)(void *opaque, uint64_t offset, uint64_t *value, unsigned size, uint32_t attrs);
    MemTxResult (*write_with_attrs)(void *opaque, uint64_t offset, uint64_t value, unsigned size, uint32_t attrs);
    int endianness;
    struct {
        unsigned min_access_size, max_access_size;
        bool unaligned;
        void *accepts;
    } valid;
    struct {
        unsigned min_access_size, max_access_size;
        bool unaligned;
    } impl;
} MemoryRegionOps;
#define LITTLE_ENDIAN_DEVICE 2

void memory_region_init_io(MemoryRegion *region, Object *owner, const MemoryRegionOps *ops, void *opaque,
                           const char *name, uint64_t size);
void memory_region_add_subregion_overlap(MemoryRegion *container, uint64_t offset, MemoryRegion *region, int priority);
void memory_region_set_enabled(MemoryRegion *region, bool enabled);
MemoryRegion *get_system_memory(void);
void cpu_physical_memory_rw(uint64_t address, void *buffer, uint64_t size, bool write);
extern char address_space_memory[];
MemTxResult address_space_write_rom(void *space, uint64_t address, uint32_t attrs, const void *buffer, uint64_t size);

/* ---------------------------------------------------------------- objects, interrupts, time, reset */
typedef struct IRQState *qemu_irq;
Object *object_resolve_path_type(const char *path, const char *type, bool *ambiguous);
Object *object_property_get_link(Object *object, const char *name, void **error);
qemu_irq qdev_get_gpio_in(Object *device, int number);
qemu_irq qdev_get_gpio_in_named(Object *device, const char *name, int number);
void qemu_set_irq(qemu_irq irq, int level);

typedef struct {
    _Alignas(16) char opaque[256];
} QEMUTimer;
#define CLOCK_VIRTUAL 1
#define SCALE_NS 1
void timer_init_full(QEMUTimer *timer, void *group, int clock, int scale, int attributes, void (*callback)(void *),
                     void *opaque);
void timer_mod(QEMUTimer *timer, int64_t expires);
void timer_del(QEMUTimer *timer);
int64_t qemu_clock_get_ns(int clock);

void qemu_register_reset(void (*callback)(void *), void *opaque);
void qemu_system_reset_request(int cause);
#define CAUSE_GUEST_RESET 7

#endif
