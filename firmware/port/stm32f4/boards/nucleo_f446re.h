/* NUCLEO-F446RE. */
#define BOARD_CHIP F446
#define BOARD_HSE_BYPASS 1 /* the debugger's MCO gives 8 MHz */
#define BOARD_USART 2      /* through the on-board debugger: PA2, PA3 */
