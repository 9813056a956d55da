/* Counts instructions and modelled cycles (cycles.c) from the first instruction of an interrupt to its last, and to a
 * mark in between; and the longest time for which interrupts were locked.
 */
#include "board.h"

#include <stdlib.h>

#define PLACES 16
#define CPSID_I 0xB672u
#define CPSIE_I 0xB662u
/* Registers are stacked and the vector is read, and back: 12 cycles each at zero waits. */
#define EXCEPTION_ENTRY 12
#define EXCEPTION_RETURN 12
/* A taken branch fills the pipeline anew: 1 to 3 cycles. */
#define REFILL 3

enum role { ROLE_NONE, ROLE_ENTRY, ROLE_EXIT, ROLE_MARK, ROLE_LOCK, ROLE_UNLOCK };

struct instruction {
    uint32_t address, size, cycles;
    enum role role;
};

static uint64_t entry, exits[PLACES], marks[PLACES];
static unsigned exit_count, mark_count;
static uint64_t instructions, cycles;
static uint64_t instructions_began, cycles_began, lock_began;
static uint32_t follows_at; /* where the next instruction lies unless this one branches */
static bool counts, inside, locked;
static struct {
    uint64_t runs, most_instructions, most_cycles, most_cycles_to_mark, longest_lock;
} figures;

static void raise_to(uint64_t *most, uint64_t figure)
{
    if (figure > *most)
        *most = figure;
}

static void begin(void)
{
    inside = true;
    instructions_began = instructions;
    cycles_began = cycles;
    cycles += EXCEPTION_ENTRY;
    cycles_cache_cold(); /* the main loop may have had all of it */
}

static void end(void)
{
    if (!inside)
        return;
    inside = false;
    figures.runs++;
    raise_to(&figures.most_instructions, instructions - instructions_began);
    raise_to(&figures.most_cycles, cycles + EXCEPTION_RETURN - cycles_began);
}

static void account(const struct instruction *instruction)
{
    if (instruction->address != follows_at)
        cycles += REFILL + cycles_of_jump(instruction->address);
    cycles_fetched(instruction->address);
    follows_at = instruction->address + instruction->size;
    instructions++;
    cycles += instruction->cycles;
}

static void on_instruction(unsigned vcpu, void *data)
{
    const struct instruction *instruction = data;
    (void)vcpu;
    if (instruction->role == ROLE_ENTRY)
        begin();
    account(instruction);
    switch (instruction->role) {
    case ROLE_EXIT:
        end();
        break;
    case ROLE_MARK:
        if (inside)
            raise_to(&figures.most_cycles_to_mark, cycles - cycles_began);
        break;
    case ROLE_LOCK:
        locked = true;
        lock_began = cycles;
        break;
    case ROLE_UNLOCK:
        if (locked)
            raise_to(&figures.longest_lock, cycles - lock_began);
        locked = false;
        break;
    case ROLE_NONE:
    case ROLE_ENTRY:
        break;
    }
}

static void on_access(unsigned vcpu, uint32_t info, uint64_t address, void *data)
{
    (void)vcpu, (void)data;
    cycles += cycles_of_access((uint32_t)address, qemu_plugin_mem_is_store(info));
}

uint64_t count_later(unsigned cycles_later)
{
    return counts ? cycles + cycles_later : 0;
}

bool count_is_over(uint64_t cycle)
{
    return cycles >= cycle;
}

static bool among(const uint64_t *places, unsigned count, uint64_t address)
{
    for (unsigned i = 0; i < count; i++)
        if (places[i] == address)
            return true;
    return false;
}

static enum role role_of(uint64_t address, const void *code, size_t size)
{
    const uint8_t *bytes = code;
    unsigned word = bytes[0] | (unsigned)bytes[1] << 8;
    if (address == entry)
        return ROLE_ENTRY;
    if (among(exits, exit_count, address))
        return ROLE_EXIT;
    if (among(marks, mark_count, address))
        return ROLE_MARK;
    if (size == 2 && word == CPSID_I)
        return ROLE_LOCK;
    return size == 2 && word == CPSIE_I ? ROLE_UNLOCK : ROLE_NONE;
}

/* Kept for as long as the emulator runs: QEMU may call back with it at any time. */
static struct instruction *instruction_of(const struct qemu_plugin_insn *insn)
{
    const void *code = qemu_plugin_insn_data(insn);
    size_t size = qemu_plugin_insn_size(insn);
    uint64_t address = qemu_plugin_insn_vaddr(insn);
    struct instruction *instruction = malloc(sizeof *instruction);
    if (!instruction)
        board_broken("no memory is left to count instructions");
    *instruction =
        (struct instruction){(uint32_t)address, (uint32_t)size, cycles_of(code, size), role_of(address, code, size)};
    return instruction;
}

static void translate(qemu_plugin_id_t id, struct qemu_plugin_tb *tb)
{
    (void)id;
    for (size_t i = 0; i < qemu_plugin_tb_n_insns(tb); i++) {
        struct qemu_plugin_insn *insn = qemu_plugin_tb_get_insn(tb, i);
        qemu_plugin_register_vcpu_insn_exec_cb(insn, on_instruction, PLUGIN_NO_REGISTERS, instruction_of(insn));
        qemu_plugin_register_vcpu_mem_cb(insn, on_access, PLUGIN_NO_REGISTERS, PLUGIN_READ_AND_WRITE, NULL);
    }
}

static const char *places(const char *text, uint64_t *to, unsigned room, unsigned *count)
{
    while (*text && *text != ':' && *count < room) {
        char *end_of_number;
        to[(*count)++] = strtoull(text, &end_of_number, 16);
        text = *end_of_number == '+' ? end_of_number + 1 : end_of_number;
    }
    return *text == ':' ? text + 1 : text;
}

/* count=ENTRY:EXIT+EXIT...:MARK+MARK..., in hex */
void count_open(qemu_plugin_id_t id, const char *argument)
{
    unsigned one = 0;
    counts = true;
    argument = places(argument, &entry, 1, &one);
    argument = places(argument, exits, PLACES, &exit_count);
    places(argument, marks, PLACES, &mark_count);
    qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
}

size_t count_report(uint64_t *to, size_t room)
{
    if (room < COUNT_FIGURES)
        return 0;
    to[0] = figures.runs;
    to[1] = figures.most_instructions;
    to[2] = figures.most_cycles;
    to[3] = figures.most_cycles_to_mark;
    to[4] = figures.longest_lock;
    figures.runs = figures.most_instructions = figures.most_cycles = 0;
    figures.most_cycles_to_mark = figures.longest_lock = 0;
    return COUNT_FIGURES;
}
