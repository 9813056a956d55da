/* Any board with an STM32F405RG. */
#define BOARD_CHIP F405
#define BOARD_HSE_BYPASS 0 /* an 8 MHz crystal */
#define BOARD_USART 1      /* PA9, PA10 */
