#include "port/stm32f4/tick.h"

#include <stddef.h>

#include "app/device_tick.h"
#include "app/reaction.h"
#include "core/fixed.h"
#include "port/stm32f4/board.h"
#include "port/stm32f4/clock.h"
#include "port/stm32f4/converters.h"
#include "port/stm32f4/pins.h"
#include "port/stm32f4/watchdog.h"

#define PERIOD_COUNTS (TIMER_HZ / TICK_RATE_HZ)
_Static_assert(PERIOD_COUNTS *TICK_RATE_HZ == TIMER_HZ, "the tick rate must divide the timer's");

/* The longest the main loop is busy is the expansion of a model's tables, some 10 ms. */
#define MAIN_LOOP_TICKS 500u
#define TICK_CYCLES (SYSCLK_HZ / TICK_RATE_HZ)
/* No lock begins so shortly before a tick is due that it could delay it: the longest takes 20 us (`make budget`). */
#define LOCK_COUNTS (TIMER_HZ / 50000u)
_Static_assert(LOCK_COUNTS < PERIOD_COUNTS / 2, "a lock must fit between two ticks");

/* Between two questions to the DAC. The main loop asks, where there is time; one that is busy for long leaves it to the
 * tick. */
#define DAC_TICKS 7u
#define DAC_TICKS_MOST 20u
#define TRIGGER_LINE BIT(PIN_TRIGGER_IN) /* of the EXTI, which keeps an edge until it is looked at */
#define TRIGGER_PINS (((1u << TRIGGERS) - 1u) << PIN_TRIGGER_OUT)
#define INTERLOCK_TICKS 3u /* open that long, it is no spike */
/* So often in a row a converter may fail to answer, or the ADC to convert, before it is a fault: once is a spike. */
#define MISSES 2u
/* As long as the ADC is silent it is reset this often, by a pulse of one tick; it needs two more to set itself up. */
#define ADC_RESET_TICKS 50u
#define DETAIL_ADC_SILENT 0u
#define DETAIL_DAC_SILENT 1u
#define DETAIL_NO_CONVERSION 2u

volatile uint32_t tick_parked_count;

static struct device *ticking;
static volatile uint32_t since_main_loop;
static uint16_t adc_codes[AXES]; /* the last that the ADC gave */
static uint32_t interlock_open_ticks;
static uint32_t adc_misses, dac_misses; /* in a row */
static volatile uint32_t since_dac_asked;
static uint32_t ticked_at; /* cycle counter, at the beginning of the last tick */
/* DAC_BACK: it answers again, and is asked for its codes. DAC_BEHIND: it is on its way from them to the present ones.
 */
static enum dac { DAC_HEARS, DAC_SILENT, DAC_BACK, DAC_BEHIND } dac;
static uint16_t dac_codes_held[AXES];
static unsigned dac_codes_read;

static void watch_interlock(void)
{
    interlock_open_ticks = pin_is_high(GPIOC, PIN_INTERLOCK) ? interlock_open_ticks + 1 : 0;
    if (interlock_open_ticks == 1)
        device_input(ticking);
    if (interlock_open_ticks >= INTERLOCK_TICKS) /* as long as it is: a fault that is cleared meanwhile comes back */
        device_raise(ticking, WIRE_FAULT_INTERLOCK, NO_AXIS, 0);
}

/* Pulses begin here, as long after the sample in every tick as the interrupt takes to come, and end with the tick's
 * work. */
static void begin_pulses(const struct device *device)
{
    GPIOC->BSRR = device->control.pulsing << PIN_TRIGGER_OUT;
}

static void end_pulses(void)
{
    GPIOC->BSRR = TRIGGER_PINS << 16;
}

static void watch_trigger(struct device *device)
{
    if ((EXTI->PR & TRIGGER_LINE) == 0)
        return;
    EXTI->PR = TRIGGER_LINE;
    device_trigger_edge(device);
}

static void watch_adc(enum converters_sampled sampled)
{
    if (sampled == CONVERTERS_SAMPLED) {
        adc_misses = 0;
        return;
    }
    if (++adc_misses < MISSES)
        return;
    device_raise(ticking, WIRE_FAULT_CONVERTER_SILENT, NO_AXIS,
                 sampled == CONVERTERS_STALE ? DETAIL_NO_CONVERSION : DETAIL_ADC_SILENT);
    if (adc_misses == MISSES + ADC_RESET_TICKS)
        adc_misses = MISSES;
    converters_hold_adc_in_reset(adc_misses == MISSES);
}

/* A DAC that answers again is not sent its present code at once, which would be a jump. */
static void dac_answered(bool answered)
{
    dac_misses = answered ? 0 : dac_misses + 1;
    if (dac_misses >= MISSES) {
        dac = DAC_SILENT;
        device_raise(ticking, WIRE_FAULT_CONVERTER_SILENT, NO_AXIS, DETAIL_DAC_SILENT);
    } else if (!answered) {
        since_dac_asked = DAC_TICKS - 1; /* again after the next tick */
    } else if (dac == DAC_SILENT) {
        dac = DAC_BACK;
        dac_codes_read = 0;
        since_dac_asked = DAC_TICKS - 1;
    }
}

static void read_back(void)
{
    dac_codes_held[dac_codes_read] = converters_read_back(dac_codes_read);
    dac_codes_read++;
    if (dac_codes_read == AXES)
        dac = DAC_BEHIND;
    else
        since_dac_asked = DAC_TICKS - 1;
}

/* While ticks are kept out: one answer at a time, which takes 9 us. */
static void ask_dac(void)
{
    since_dac_asked = 0;
    if (dac == DAC_BACK)
        read_back();
    else
        dac_answered(converters_dac_answers());
}

void tick_between(void)
{
    since_main_loop = 0;
    if (since_dac_asked < DAC_TICKS)
        return;
    tick_lock(NULL);
    ask_dac();
    tick_unlock(NULL);
}

/* Moves the DAC's codes towards those that it should have, each axis by the step of its ramp. */
static void catch_up(const uint16_t codes[AXES])
{
    bool behind = false;
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct axis_config *config = &ticking->control.config[axis];
        int32_t ramp = (int32_t)mul_shift_wide_i32(config->ramp_q24, config->converter.dac_codes_per_V_q16, 40);
        int32_t step = ramp > 1 ? ramp : 1, way = codes[axis] - dac_codes_held[axis];
        dac_codes_held[axis] = (uint16_t)(dac_codes_held[axis] + clamp_i32(way, -step, step));
        behind = behind || dac_codes_held[axis] != codes[axis];
    }
    if (!behind)
        dac = DAC_HEARS;
}

/* What to send to a DAC that missed some codes; NULL: nothing yet. */
static const uint16_t *codes_behind(const uint16_t codes[AXES])
{
    if (dac == DAC_SILENT || dac == DAC_BACK)
        return NULL;
    catch_up(codes);
    return dac_codes_held;
}

/* Ticks that should have begun since the last one, by the cycle counter, which nothing stops. */
static inline __attribute__((always_inline)) uint32_t ticks_due(uint32_t now)
{
    uint32_t cycles = now - ticked_at;
    ticked_at = now;
    return cycles < TICK_CYCLES + TICK_CYCLES / 2 ? 1 : (cycles + TICK_CYCLES / 2) / TICK_CYCLES;
}

static void keep_time(struct device *device, uint32_t start)
{
    uint32_t cycles = DWT->CYCCNT - start;
    uint32_t bin = 31u - leading_zeros_u32(cycles | 1u);
    device->cycles_last = cycles;
    if (cycles > device->cycles_max)
        device->cycles_max = cycles;
    device->cycles_histogram[bin < 15u ? bin : 15u]++;
    if ((TIM2->SR & TIM_SR_CC3IF) != 0) {
        device->overruns++;
        device_raise(device, WIRE_FAULT_TICK_OVERRUN, NO_AXIS, cycles);
    }
}

void tick_interrupt(void)
{
    uint32_t start = DWT->CYCCNT;
    struct device *device = ticking;
    uint16_t dac_codes[AXES];
    TIM2->SR = ~TIM_SR_CC3IF;
    begin_pulses(device);
    uint32_t due = ticks_due(start);
    if (due > 1)
        device_lose_ticks(device, due - 1);
    watch_adc(converters_sample(adc_codes));
    watch_interlock();
    watch_trigger(device);
    device_tick(device, adc_codes, dac_codes);
    if (++since_dac_asked >= DAC_TICKS_MOST)
        ask_dac();
    if (since_main_loop++ < MAIN_LOOP_TICKS)
        watchdog_feed();
    end_pulses();
    keep_time(device, start);
}

void tick_drive(void *context, const uint16_t dac_codes[AXES])
{
    (void)context;
    const uint16_t *codes = dac == DAC_HEARS ? dac_codes : codes_behind(dac_codes);
    if (codes != NULL)
        converters_drive(codes);
    if (TIM2->CNT >= LATCH_COUNTS - LATCH_SETUP_COUNTS)
        ticking->latched_late++;
}

RAM_CODE void tick_parked(void)
{
    TIM2->SR = ~TIM_SR_CC3IF;
    if ((GPIOC->IDR >> PIN_INTERLOCK & 1u) == 0)
        interlock_open_ticks = 0;
    else if (interlock_open_ticks < INTERLOCK_TICKS - 1) /* the last one is left to a tick that can react */
        interlock_open_ticks++;
    tick_parked_count += ticks_due(DWT->CYCCNT);
    IWDG->KR = IWDG_FEED;
}

void tick_lock(void *context)
{
    (void)context;
    while (TIM2->CNT >= PERIOD_COUNTS - LOCK_COUNTS)
        ;
    __asm volatile("cpsid i" ::: "memory");
}

void tick_unlock(void *context)
{
    (void)context;
    __asm volatile("cpsie i" ::: "memory");
}

static void set_up_triggers(void)
{
    for (unsigned i = 0; i < TRIGGERS; i++)
        pin_set_up(GPIOC, PIN_TRIGGER_OUT + i, PIN_OUTPUT, PULL_NONE, 0);
    pin_set_up(GPIOC, PIN_TRIGGER_IN, PIN_INPUT, PULL_DOWN, 0);
    SYSCFG->EXTICR[PIN_TRIGGER_IN / 4] = SYSCFG_EXTICR_PORT_C; /* the clock of SYSCFG is on since the converters */
    EXTI->RTSR |= TRIGGER_LINE;
    EXTI->IMR |= TRIGGER_LINE; /* pending is all that is wanted, as with BUSY */
    EXTI->PR = TRIGGER_LINE;
}

void tick_start(struct device *device)
{
    ticking = device;
    pin_set_up(GPIOC, PIN_INTERLOCK, PIN_INPUT, PULL_UP, 0);
    set_up_triggers();
    DEMCR |= DEMCR_TRCENA;
    DWT->CYCCNT = 0;
    DWT->CTRL |= DWT_CTRL_CYCCNTENA;
    clock_enable(&RCC->APB1ENR, RCC_APB1ENR_TIM2);
    TIM2->ARR = PERIOD_COUNTS - 1u;
    TIM2->CCR1 = CONVST_HIGH_COUNTS;
    TIM2->CCR2 = LATCH_COUNTS;
    TIM2->CCR3 = SAMPLED_COUNTS;
    TIM2->CCMR1 = TIM_CCMR1_OC1_PWM1 | TIM_CCMR1_OC2_PWM1;
    TIM2->CCER = TIM_CCER_CC1E | TIM_CCER_CC2E;
    TIM2->EGR = TIM_EGR_UG;
    TIM2->SR = 0;
    TIM2->DIER = TIM_DIER_CC3IE;
    NVIC->IPR[IRQ_TIM2] = 0;
    NVIC->ISER[IRQ_TIM2 / 32] = BIT(IRQ_TIM2 % 32);
    ticked_at = DWT->CYCCNT;
    TIM2->CR1 = TIM_CR1_CEN;
}
