#ifndef PHASELEAD_STM32F4_PINS_H
#define PHASELEAD_STM32F4_PINS_H

#include <stdbool.h>

#include "port/stm32f4/registers.h"

enum pin_mode { PIN_INPUT, PIN_OUTPUT, PIN_FUNCTION };
enum pin_pull { PULL_NONE, PULL_UP, PULL_DOWN };

/* An output is set to `function` (0 or 1) before it begins to drive. */
void pin_set_up(struct gpio *port, unsigned pin, enum pin_mode mode, enum pin_pull pull, unsigned function);

static inline void pin_high(struct gpio *port, unsigned pin)
{
    port->BSRR = BIT(pin);
}

static inline void pin_low(struct gpio *port, unsigned pin)
{
    port->BSRR = BIT(pin + 16u);
}

static inline bool pin_is_high(const struct gpio *port, unsigned pin)
{
    return port->IDR >> pin & 1u;
}

#endif
