/* Which hardware this firmware is for, in words that are in the ELF but not in flash: the emulator reads them. */
#include "port/stm32f4/board.h"

#define WORD(text) #text
#define WORD_OF(macro) WORD(macro)

extern const char board_hardware[];
__attribute__((section(".board"), used)) const char board_hardware[] =
    "chip=" WORD_OF(BOARD_CHIP) ",usart=" WORD_OF(BOARD_USART);
