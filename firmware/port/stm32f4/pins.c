#include "port/stm32f4/pins.h"

#define FAST 2u /* 50 MHz edges; the buses run at 21 MHz */

static void set_field(volatile uint32_t *reg, unsigned pin, unsigned bits, uint32_t value)
{
    uint32_t mask = (1u << bits) - 1u;
    *reg = (*reg & ~(mask << (pin * bits))) | value << (pin * bits);
}

void pin_set_up(struct gpio *port, unsigned pin, enum pin_mode mode, enum pin_pull pull, unsigned function)
{
    if (mode == PIN_FUNCTION)
        set_field(&port->AFR[pin / 8], pin % 8, 4, function);
    else if (mode == PIN_OUTPUT)
        port->BSRR = function != 0 ? BIT(pin) : BIT(pin + 16u);
    set_field(&port->OSPEEDR, pin, 2, FAST);
    set_field(&port->PUPDR, pin, 2, (uint32_t)pull);
    set_field(&port->MODER, pin, 2, (uint32_t)mode);
}
