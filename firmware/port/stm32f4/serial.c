#include "port/stm32f4/serial.h"

#include "app/service.h"
#include "port/stm32f4/board.h"
#include "port/stm32f4/clock.h"
#include "port/stm32f4/pins.h"

/* 10 ms at 2 Mbaud: more than the host sends before it waits for an answer. */
#define RECEIVE_SIZE 2048u

#if BOARD_USART == 2
#define USART USART2
#define USART_HZ APB1_HZ
#define DMA DMA1
#define RECEIVE_STREAM 5
#define SEND_STREAM 6
#define SEND_IRQ IRQ_DMA1_STREAM6
#define PIN_TX 2
#define PIN_RX 3
#else
#define USART USART1
#define USART_HZ APB2_HZ
#define DMA DMA2
#define RECEIVE_STREAM 5
#define SEND_STREAM 7
#define SEND_IRQ IRQ_DMA2_STREAM7
#define PIN_TX 9
#define PIN_RX 10
#endif
#define USART_DMA_CHANNEL 4
#define LOWEST_PRIORITY 0xF0u

/* 16 samples a bit: BRR is the divider itself. Within 1 % it has to be, or the bits drift off. */
#define DIVIDER ((USART_HZ + PHASELEAD_BAUD / 2) / PHASELEAD_BAUD)
_Static_assert(DIVIDER >= 16, "the line is faster than the USART can be");
_Static_assert(DIVIDER *PHASELEAD_BAUD<USART_HZ / 100 * 101 && DIVIDER * PHASELEAD_BAUD> USART_HZ / 100 * 99,
               "this speed does not divide well enough");

/* Flags of streams 4..7 are in the high registers, at these shifts. */
#define HIGH_SHIFT(stream) ((stream) == 4 ? 0 : (stream) == 5 ? 6 : (stream) == 6 ? 16 : 22)

static uint8_t received[RECEIVE_SIZE];
static uint32_t taken;   /* index of the next byte to take */
static uint32_t sending; /* bytes under way; 0: none */

void serial_set_up(void)
{
    clock_enable(&RCC->AHB1ENR, RCC_AHB1ENR_GPIO(PORT_A) | (BOARD_USART == 2 ? RCC_AHB1ENR_DMA1 : RCC_AHB1ENR_DMA2));
    if (BOARD_USART == 2)
        clock_enable(&RCC->APB1ENR, RCC_APB1ENR_USART2);
    else
        clock_enable(&RCC->APB2ENR, RCC_APB2ENR_USART1);
    pin_set_up(GPIOA, PIN_TX, PIN_FUNCTION, PULL_UP, AF_USART);
    pin_set_up(GPIOA, PIN_RX, PIN_FUNCTION, PULL_UP, AF_USART);
    USART->BRR = DIVIDER;
    USART->CR3 = USART_CR3_DMAR | USART_CR3_DMAT;
    struct dma_stream *in = &DMA->stream[RECEIVE_STREAM], *out = &DMA->stream[SEND_STREAM];
    in->PAR = (uint32_t)&USART->DR;
    in->M0AR = (uint32_t)received;
    in->NDTR = RECEIVE_SIZE;
    in->CR = DMA_CR_CHANNEL(USART_DMA_CHANNEL) | DMA_CR_MINC | DMA_CR_CIRC | DMA_CR_EN;
    out->PAR = (uint32_t)&USART->DR;
    USART->CR1 = USART_CR1_UE | USART_CR1_TE | USART_CR1_RE;
    NVIC->IPR[SEND_IRQ] = LOWEST_PRIORITY;
    NVIC->ISER[SEND_IRQ / 32] = BIT(SEND_IRQ % 32);
}

/* After a bad byte the receiver waits until its flags have been read; the frame it was in fails its CRC. */
static void clear_line_errors(void)
{
    if ((USART->SR & USART_SR_ERRORS) != 0)
        (void)USART->DR;
}

static bool receive(struct device *device)
{
    uint32_t head = RECEIVE_SIZE - DMA->stream[RECEIVE_STREAM].NDTR;
    uint32_t end = head >= taken ? head : RECEIVE_SIZE; /* up to the wrap now, the rest in the next turn */
    if (end == taken)
        return false;
    size_t used = service_receive(device, received + taken, end - taken);
    taken = (taken + (uint32_t)used) % RECEIVE_SIZE;
    return used > 0;
}

static bool send(struct device *device)
{
    struct dma_stream *out = &DMA->stream[SEND_STREAM];
    if (sending != 0) {
        if ((DMA->ISR[1] >> HIGH_SHIFT(SEND_STREAM) & DMA_TCIF) == 0)
            return false;
        DMA->IFCR[1] = DMA_ALL_FLAGS << HIGH_SHIFT(SEND_STREAM);
        service_sent(device, sending);
        sending = 0;
    }
    size_t size;
    const uint8_t *bytes = service_outgoing(device, &size);
    if (!bytes)
        return false;
    sending = (uint32_t)size;
    out->M0AR = (uint32_t)bytes;
    out->NDTR = sending;
    __asm volatile("dsb" ::: "memory");
    out->CR = DMA_CR_CHANNEL(USART_DMA_CHANNEL) | DMA_CR_MINC | DMA_CR_TO_PERIPHERAL | DMA_CR_TCIE | DMA_CR_EN;
    return true;
}

bool serial_poll(struct device *device)
{
    clear_line_errors();
    bool came = receive(device);
    bool went = send(device);
    return came || went;
}

RAM_CODE void serial_sent(void)
{
    DMA->stream[SEND_STREAM].CR &= ~DMA_CR_TCIE; /* the flag itself is for serial_poll() */
}
