/* The emulated board: what lies around the processor, as far as the firmware uses it. One file a part.
 *
 * It is a model of the parts, not of this firmware: a peripheral without its clock does not answer, a converter spoken
 * to in the wrong SPI mode hears nothing, and a read of flash that is being erased ends the run.
 */
#ifndef PHASELEAD_EMULATOR_BOARD_H
#define PHASELEAD_EMULATOR_BOARD_H

#include "qemu.h"

#define AXES 3
#define TICK_NS 200000
#define ZERO_V_CODE 0x8000

struct board {
    bool f446;
    unsigned usart;      /* the one that is wired: 1 or 2 */
    bool delays;         /* parts take their time, as long as their data sheets allow */
    const char *problem; /* NULL: none yet */
};
extern struct board board;

/* Ends the run: the firmware did what silicon would not forgive. The message goes to the host. */
_Noreturn void board_broken(const char *format, ...) __attribute__((format(printf, 1, 2)));
int64_t now_ns(void);
/* Lays a region over what QEMU has there. */
void board_map(MemoryRegion *region, const MemoryRegionOps *ops, const char *name, uint64_t address, uint64_t size);
void board_irq(int number, bool level);
void board_nmi(void);

/* ---- rcc.c: clocks and the cause of a reset */
enum reset_flag { RESET_POWER_ON, RESET_BROWN_OUT, RESET_WATCHDOG, RESET_SOFTWARE };
void rcc_map(void);
void rcc_reset(void);
void rcc_reset_by(enum reset_flag flag); /* of the reset that follows */
void rcc_crystal(bool runs);
void rcc_supply(bool low);                 /* below the voltage detector's highest threshold, above a reset */
void rcc_brown_out_level(uint32_t option); /* BOR_LEV of the option bytes: 3 is off, as chips are delivered */
uint32_t rcc_brown_out_option(void);
bool rcc_on(unsigned reg_offset, unsigned bit); /* an enable bit, by its register's offset */
uint64_t rcc_sysclk_Hz(void);
uint64_t rcc_apb_Hz(unsigned apb);
#define RCC_AHB1ENR 0x30
#define RCC_APB1ENR 0x40
#define RCC_APB2ENR 0x44

/* ---- timer.c: TIM2, which starts conversions and ticks */
void timer_map(void);
void timer_reset(void);
bool timer_runs(void);
int64_t timer_period_began_ns(void);
int64_t timer_latch_ns(void); /* when LDAC falls in this period */

/* ---- gpio.c */
enum gpio_port { GPIO_A, GPIO_B, GPIO_C };
void gpio_map(void);
void gpio_reset(void);
bool gpio_is_function(enum gpio_port port, unsigned pin, unsigned function);
/* What the pin is driven to; `pull` when it is not driven. */
bool gpio_output(enum gpio_port port, unsigned pin, bool pull);
unsigned gpio_take_pulses(void); /* mask of PC0 to PC2: those that rose since the last time */

/* ---- converters.c: SPI1 and SPI2 */
void converters_map(void);
void converters_reset(void);
void converters_power_on(void);
void converters_pins_changed(void);

/* ---- adc.c: AD7606B */
void adc_pins(bool selected, bool reset);
uint32_t adc_exchange(int64_t done_ns); /* of the word that is out by then */
void adc_word_taken(void);
void adc_convert(const uint16_t codes[AXES]);
bool adc_busy(void);
bool adc_busy_fell(void);
void adc_forget_edge(void);
bool adc_frstdata(void);
void adc_confuse(void);
void adc_power_on(void);

/* ---- dac.c: AD5764R */
void dac_pins(bool selected, bool cleared);
uint32_t dac_exchange(uint32_t byte, uint64_t clock_Hz);
void dac_output(uint16_t codes[AXES]); /* of the tick that ends now */
void dac_power_on(void);

/* ---- exti.c: edges of BUSY and of the supply */
void exti_map(void);
void exti_reset(void);
void exti_supply_fell(void);
void exti_trigger_rises(void); /* an edge at PC8 */

/* ---- line.c: USART and its DMA */
void line_map(void);
void line_reset(void);
void line_pass(int64_t ns); /* so much time went by */
void line_write(const uint8_t *bytes, size_t size);
size_t line_readable(void);
size_t line_take(uint8_t *bytes, size_t size);
void line_set_baud(uint32_t baud);
void line_garble(uint32_t bytes); /* noise on so many of the next bytes to the board */

/* ---- flash.c: controller, the sectors that it writes, and what must not be touched while busy */
#define FLASH_CELLS 0x80000
#define FLASH_KEPT_FROM 0x4000 /* what a state file holds: all but the bootloader */
void flash_map(void);
void flash_reset(void);
bool flash_waits_confirmed(void); /* enough wait states for 168 MHz, and read back since they were written */
const uint8_t *flash_cells(void);
void flash_poke(uint32_t address, const uint8_t *bytes, size_t size); /* RAM too */
uint64_t flash_changes(void);                                         /* so many erases and programs began */
void flash_cut_after(int64_t changes); /* bytes; the byte under way is left half done; negative: never */

/* ---- crc.c */
void crc_map(void);
void crc_reset(void);

/* ---- watchdog.c */
void watchdog_map(void);
void watchdog_reset(void);

/* ---- world.c: the stage, time, and the host process */
bool world_open(int in, int out, const char *library);
void world_start(void);
/* A tick of 200 us begins: the last one's output moves the stage, the line has moved, then the sensors are sampled. */
void world_tick(void);
void world_say_broken(const char *text);

/* ---- inject.c: faults, asked for by the host */
enum injection {
    INJECT_CRYSTAL_STOPS = 1,
    INJECT_NO_CRYSTAL,
    INJECT_ADC_SILENT,
    INJECT_DAC_SILENT,
    INJECT_INTERLOCK,
    INJECT_BROWN_OUT,
    INJECT_NOISE,
    INJECT_RAIL,
    INJECT_FLASH_CUT,
    INJECT_RESET_PIN,
    INJECT_ADC_CONFUSED,
    INJECT_NO_CONVERSION,
    INJECT_BOR_LEVEL,
    INJECT_SUPPLY_LOW,
    INJECT_FROZEN,
    INJECT_TRIGGER
};
extern struct injected {
    bool adc_silent, dac_silent, interlock_open, no_conversion;
    uint32_t rail_mask, frozen_mask;
} injected;
void inject(uint32_t what, uint32_t value);
void inject_reset(void); /* what goes with the reset that was asked for */

/* ---- cycles.c: what things cost, in cycles of the processor */
unsigned cycles_of(const void *code, size_t size);       /* an instruction, without waits */
unsigned cycles_of_jump(uint32_t address);               /* waits of the flash for code out of sequence */
unsigned cycles_of_access(uint32_t address, bool store); /* waits for data */
void cycles_fetched(uint32_t address);                   /* the flash has this line before it */
void cycles_cache_cold(void);

/* ---- count.c: instructions and modelled cycles between two places */
#define COUNT_FIGURES 5
void count_open(qemu_plugin_id_t id, const char *argument);
/* For parts that take no time here: the cycle that comes so many later, and whether it is over. Without counting it is
 * at once. */
uint64_t count_later(unsigned cycles_later);
bool count_is_over(uint64_t cycle);
/* Since the last report: runs; of one run the most instructions, cycles, cycles to a mark; the longest lock, cycles. */
size_t count_report(uint64_t *to, size_t room);

#endif
