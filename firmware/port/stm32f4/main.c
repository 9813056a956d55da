#include "app/build_id.h"
#include "app/device_init.h"
#include "app/fault_writing.h"
#include "app/reaction.h"
#include "port/stm32f4/board.h"
#include "port/stm32f4/clock.h"
#include "port/stm32f4/converters.h"
#include "port/stm32f4/core_lost.h"
#include "port/stm32f4/flash.h"
#include "port/stm32f4/serial.h"
#include "port/stm32f4/start.h"
#include "port/stm32f4/supply.h"
#include "port/stm32f4/tick.h"
#include "port/stm32f4/watchdog.h"

static struct device device;
static struct fault_log fault_log __attribute__((section(".kept.faults")));

int main(void);

/* Of several flags the one that says most: a reset pulls the reset pin too, and a power-on is a brown-out as well. */
static enum wire_reset_cause reset_cause(void)
{
    uint32_t flags = RCC->CSR;
    RCC->CSR |= RCC_CSR_RMVF;
    if ((flags & RCC_CSR_PORRSTF) != 0)
        return WIRE_RESET_CAUSE_POWER_ON;
    if ((flags & RCC_CSR_BORRSTF) != 0)
        return WIRE_RESET_CAUSE_BROWN_OUT;
    if ((flags & RCC_CSR_IWDGRSTF) != 0)
        return WIRE_RESET_CAUSE_WATCHDOG;
    return (flags & RCC_CSR_SFTRSTF) != 0 ? WIRE_RESET_CAUSE_SOFTWARE : WIRE_RESET_CAUSE_PIN;
}

static void raise_what_went_before(enum wire_reset_cause cause, enum clock_source clock, bool dac_answers)
{
    uint32_t lost = core_lost_take();
    if (lost != 0 && cause == WIRE_RESET_CAUSE_SOFTWARE)
        device_raise(&device, WIRE_FAULT_CORE_LOST, NO_AXIS, lost);
    else if (clock != CLOCK_CRYSTAL)
        device_raise(&device, WIRE_FAULT_CORE_LOST, NO_AXIS, CORE_LOST_DETAIL(WIRE_CORE_LOSS_NO_CRYSTAL, 0));
    if (!dac_answers)
        device_raise(&device, WIRE_FAULT_CONVERTER_SILENT, NO_AXIS, 1);
}

/* A function of its own, so that what it needs on the stack is free again when commands come. */
__attribute__((noinline)) static void set_up(void)
{
    converters_set_up(); /* first of all: the output is 0 V from here on by our own hand too */
    enum wire_reset_cause cause = reset_cause();
    core_lost_arm();
    if (!supply_comes_up())
        core_lost(WIRE_CORE_LOSS_SUPPLY_LOW, 0);
    supply_watch();
    enum clock_source clock = clock_start();
    if (clock == CLOCK_SLOW)
        core_lost(WIRE_CORE_LOSS_CLOCK_STOPPED, 0);
    converters_reset_adc(); /* it is ready again long before the first tick */
    struct device_port port = {.flash = flash_models(&device),
                               .records = flash_journal(&device),
                               .fault_log = &fault_log,
                               .update = flash_images(&device, start_was_a_trial()),
                               .lock = tick_lock,
                               .unlock = tick_unlock,
                               .drive = tick_drive,
                               .baud = PHASELEAD_BAUD,
                               .reset_cause = cause,
                               .brown_out_level = (uint8_t)supply_brown_out_level(),
                               .target = BOARD_NAME};
    build_id(port.build_id);
    device_init(&device, &port); /* some 18 ms with a model, tables and inverse of three axes */
    /* Until here the converter is cleared by its pin, and the bootloader's slow watchdog ends a start that hangs. */
    watchdog_start(WATCHDOG_FAST, WATCHDOG_FAST_RELOAD);
    serial_set_up();
    raise_what_went_before(cause, clock, converters_start());
    tick_start(&device);
    update_read_record(&device.update, &device.port.update);
}

int main(void)
{
    set_up();
    for (;;) {
        tick_between();
        fault_log_write(&device);
        if (update_restart_is_due(&device.update, device.control.tick))
            start_again();
        if (!serial_poll(&device))
            __asm volatile("wfi");
    }
}
