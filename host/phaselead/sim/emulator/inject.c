#include "board.h"

struct injected injected;

static bool supply_dipped;

/* Memory forgets, and so do the converters. */
void inject_reset(void)
{
    if (!supply_dipped)
        return;
    supply_dipped = false;
    static uint8_t noise[0x1000];
    for (size_t i = 0; i < sizeof noise; i++)
        noise[i] = (uint8_t)(0xA5u ^ i * 37u);
    for (uint64_t at = 0; at < 0x20000; at += sizeof noise)
        cpu_physical_memory_rw(0x20000000 + at, noise, sizeof noise, true);
    converters_power_on();
}

static void brown_out(void)
{
    supply_dipped = true;
    rcc_reset_by(RESET_BROWN_OUT);
    qemu_system_reset_request(CAUSE_GUEST_RESET);
}

void inject(uint32_t what, uint32_t value)
{
    switch ((enum injection)what) {
    case INJECT_CRYSTAL_STOPS:
    case INJECT_NO_CRYSTAL:
        rcc_crystal(value == 0);
        break;
    case INJECT_ADC_SILENT:
        injected.adc_silent = value;
        break;
    case INJECT_DAC_SILENT:
        injected.dac_silent = value;
        break;
    case INJECT_INTERLOCK:
        injected.interlock_open = value;
        break;
    case INJECT_BROWN_OUT:
        brown_out();
        break;
    case INJECT_NOISE:
        line_garble(value);
        break;
    case INJECT_RAIL:
        injected.rail_mask = value;
        break;
    case INJECT_FLASH_CUT:
        flash_cut_after(value);
        break;
    case INJECT_ADC_CONFUSED:
        adc_confuse();
        break;
    case INJECT_NO_CONVERSION:
        injected.no_conversion = value;
        break;
    case INJECT_BOR_LEVEL:
        rcc_brown_out_level(value);
        break;
    case INJECT_SUPPLY_LOW:
        rcc_supply(value);
        break;
    case INJECT_FROZEN:
        injected.frozen_mask = value;
        break;
    case INJECT_TRIGGER:
        exti_trigger_rises();
        break;
    case INJECT_RESET_PIN:
        qemu_system_reset_request(CAUSE_GUEST_RESET);
        break;
    }
}
