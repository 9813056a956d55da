/* Counts instructions from the first of a function to its last, and to a mark in between. */
#include "board.h"

#include <stdlib.h>

#define PLACES 16

static uint64_t entry, exits[PLACES], marks[PLACES];
static unsigned exit_count, mark_count;
static uint64_t executed, began;
static bool inside;
static struct {
    uint64_t runs, sum, most, most_to_mark;
} figures;

static void on_entry(unsigned vcpu, void *data)
{
    (void)vcpu, (void)data;
    inside = true;
    began = executed;
}

static void on_mark(unsigned vcpu, void *data)
{
    (void)vcpu, (void)data;
    uint64_t count = executed - began + 1;
    if (inside && count > figures.most_to_mark)
        figures.most_to_mark = count;
}

static void on_exit_(unsigned vcpu, void *data)
{
    (void)vcpu, (void)data;
    if (!inside)
        return;
    uint64_t count = executed - began + 1;
    inside = false;
    figures.runs++;
    figures.sum += count;
    if (count > figures.most)
        figures.most = count;
}

static bool among(const uint64_t *places, unsigned count, uint64_t address)
{
    for (unsigned i = 0; i < count; i++)
        if (places[i] == address)
            return true;
    return false;
}

static void translate(qemu_plugin_id_t id, struct qemu_plugin_tb *tb)
{
    (void)id;
    for (size_t i = 0; i < qemu_plugin_tb_n_insns(tb); i++) {
        struct qemu_plugin_insn *insn = qemu_plugin_tb_get_insn(tb, i);
        uint64_t address = qemu_plugin_insn_vaddr(insn);
        if (address == entry)
            qemu_plugin_register_vcpu_insn_exec_cb(insn, on_entry, PLUGIN_NO_REGISTERS, NULL);
        if (among(marks, mark_count, address))
            qemu_plugin_register_vcpu_insn_exec_cb(insn, on_mark, PLUGIN_NO_REGISTERS, NULL);
        if (among(exits, exit_count, address))
            qemu_plugin_register_vcpu_insn_exec_cb(insn, on_exit_, PLUGIN_NO_REGISTERS, NULL);
        qemu_plugin_register_vcpu_insn_exec_inline(insn, PLUGIN_INLINE_ADD, &executed, 1);
    }
}

static const char *places(const char *text, uint64_t *to, unsigned *count)
{
    while (*text && *text != ':' && *count < PLACES) {
        char *end;
        to[(*count)++] = strtoull(text, &end, 16);
        text = *end == '+' ? end + 1 : end;
    }
    return *text == ':' ? text + 1 : text;
}

/* count=ENTRY:EXIT+EXIT...:MARK+MARK..., in hex */
void count_open(qemu_plugin_id_t id, const char *argument)
{
    unsigned one = 0;
    argument = places(argument, &entry, &one);
    argument = places(argument, exits, &exit_count);
    places(argument, marks, &mark_count);
    qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
}

/* Runs, their sum, the most of one, the most up to a mark; since the last report. */
size_t count_report(uint64_t *to, size_t room)
{
    if (room < 4)
        return 0;
    to[0] = figures.runs;
    to[1] = figures.sum;
    to[2] = figures.most;
    to[3] = figures.most_to_mark;
    figures.runs = figures.sum = figures.most = figures.most_to_mark = 0;
    return 4;
}
