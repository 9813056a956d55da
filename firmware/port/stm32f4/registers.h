/* Registers of the STM32F405 (RM0090) and STM32F446 (RM0390) that the port uses, and of their Cortex-M4 core (PM0214).
 * Both parts have these peripherals at the same addresses, with the same bits.
 */
#ifndef PHASELEAD_STM32F4_REGISTERS_H
#define PHASELEAD_STM32F4_REGISTERS_H

#include <stdint.h>

#define BIT(n) (1u << (n))

struct rcc {
    volatile uint32_t CR, PLLCFGR, CFGR, CIR, AHB1RSTR, AHB2RSTR, AHB3RSTR, reserved0, APB1RSTR, APB2RSTR, reserved1[2];
    volatile uint32_t AHB1ENR, AHB2ENR, AHB3ENR, reserved2, APB1ENR, APB2ENR, reserved3[2], LPENR[5], reserved4[3];
    volatile uint32_t BDCR, CSR;
};
#define RCC ((struct rcc *)0x40023800)
#define RCC_CR_HSEON BIT(16)
#define RCC_CR_HSERDY BIT(17)
#define RCC_CR_HSEBYP BIT(18)
#define RCC_CR_CSSON BIT(19)
#define RCC_CR_PLLON BIT(24)
#define RCC_CR_PLLRDY BIT(25)
#define RCC_PLLCFGR_M(m) (m)
#define RCC_PLLCFGR_N(n) ((n) << 6)
#define RCC_PLLCFGR_P2 0u
#define RCC_PLLCFGR_HSE BIT(22)
#define RCC_PLLCFGR_Q(q) ((q) << 24)
#define RCC_PLLCFGR_R(r) ((r) << 28) /* F446 only; reserved on the F405, where its reset value is 2 too */
#define RCC_CFGR_SW_PLL 2u
#define RCC_CFGR_SWS_MASK (3u << 2)
#define RCC_CFGR_SWS_PLL (2u << 2)
#define RCC_CFGR_APB1_DIV4 (5u << 10)
#define RCC_CFGR_APB2_DIV2 (4u << 13)
#define RCC_CIR_CSSF BIT(7)
#define RCC_CIR_CSSC BIT(23)
#define RCC_AHB1ENR_GPIO(port) BIT(port)
#define RCC_AHB1ENR_CRC BIT(12)
#define RCC_AHB1ENR_DMA1 BIT(21)
#define RCC_AHB1ENR_DMA2 BIT(22)
#define RCC_APB1ENR_TIM2 BIT(0)
#define RCC_APB1ENR_SPI2 BIT(14)
#define RCC_APB1ENR_USART2 BIT(17)
#define RCC_APB1ENR_PWR BIT(28)
#define RCC_APB2ENR_USART1 BIT(4)
#define RCC_APB2ENR_SPI1 BIT(12)
#define RCC_APB2ENR_SYSCFG BIT(14)
#define RCC_CSR_RMVF BIT(24)
#define RCC_CSR_BORRSTF BIT(25)
#define RCC_CSR_PINRSTF BIT(26)
#define RCC_CSR_PORRSTF BIT(27)
#define RCC_CSR_SFTRSTF BIT(28)
#define RCC_CSR_IWDGRSTF BIT(29)

struct flash {
    volatile uint32_t ACR, KEYR, OPTKEYR, SR, CR, OPTCR;
};
#define FLASH ((struct flash *)0x40023C00)
#define FLASH_ACR_5_WAITS 5u
#define FLASH_ACR_WAITS_MASK 7u
#define FLASH_ACR_PRFTEN BIT(8)
#define FLASH_ACR_ICEN BIT(9)
#define FLASH_ACR_DCEN BIT(10)
#define FLASH_ACR_DCRST BIT(12)
#define FLASH_SR_ERRORS 0xF2u /* OPERR, WRPERR, PGAERR, PGPERR, PGSERR */
#define FLASH_SR_EOP BIT(0)
#define FLASH_SR_BSY BIT(16)
#define FLASH_CR_PG BIT(0)
#define FLASH_CR_SER BIT(1)
#define FLASH_CR_SECTOR(n) ((n) << 3)
#define FLASH_CR_BY_BYTE (0u << 8)
#define FLASH_CR_BY_WORD (2u << 8)
#define FLASH_CR_STRT BIT(16)
#define FLASH_CR_LOCK BIT(31)
#define FLASH_OPTCR_BOR_LEV(optcr) ((optcr) >> 2 & 3u) /* 3: off, 2 to 0: levels 1 to 3 */

struct crc {
    volatile uint32_t DR, IDR, CR;
};
#define CRC ((struct crc *)0x40023000)
#define CRC_CR_RESET BIT(0)

struct gpio {
    volatile uint32_t MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFR[2];
};
#define GPIOA ((struct gpio *)0x40020000)
#define GPIOB ((struct gpio *)0x40020400)
#define GPIOC ((struct gpio *)0x40020800)

struct tim {
    volatile uint32_t CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, RCR, CCR1, CCR2, CCR3, CCR4;
};
#define TIM2 ((struct tim *)0x40000000)
#define TIM_CR1_CEN BIT(0)
#define TIM_DIER_CC3IE BIT(3)
#define TIM_SR_CC3IF BIT(3)
#define TIM_EGR_UG BIT(0)
#define TIM_CCMR1_OC1_PWM1 (6u << 4)
#define TIM_CCMR1_OC2_PWM1 (6u << 12)
#define TIM_CCER_CC1E BIT(0)
#define TIM_CCER_CC2E BIT(4)

struct spi {
    volatile uint32_t CR1, CR2, SR, DR;
};
#define SPI1 ((struct spi *)0x40013000)
#define SPI2 ((struct spi *)0x40003800)
#define SPI_CR1_CPHA BIT(0)
#define SPI_CR1_CPOL BIT(1)
#define SPI_CR1_MSTR BIT(2)
#define SPI_CR1_DIV2 (0u << 3)
#define SPI_CR1_DIV4 (1u << 3)
#define SPI_CR1_DIV8 (2u << 3)
#define SPI_CR1_SPE BIT(6)
#define SPI_CR1_SSI BIT(8)
#define SPI_CR1_SSM BIT(9)
#define SPI_CR1_DFF16 BIT(11)
#define SPI_SR_RXNE BIT(0)
#define SPI_SR_TXE BIT(1)
#define SPI_SR_BSY BIT(7)

struct usart {
    volatile uint32_t SR, DR, BRR, CR1, CR2, CR3;
};
#define USART1 ((struct usart *)0x40011000)
#define USART2 ((struct usart *)0x40004400)
#define USART_SR_ERRORS 0xFu /* ORE, NE, FE, PE */
#define USART_CR1_RE BIT(2)
#define USART_CR1_TE BIT(3)
#define USART_CR1_UE BIT(13)
#define USART_CR3_DMAR BIT(6)
#define USART_CR3_DMAT BIT(7)

struct dma_stream {
    volatile uint32_t CR, NDTR, PAR, M0AR, M1AR, FCR;
};
struct dma {
    volatile uint32_t ISR[2], IFCR[2];
    struct dma_stream stream[8];
};
#define DMA1 ((struct dma *)0x40026000)
#define DMA2 ((struct dma *)0x40026400)
#define DMA_CR_EN BIT(0)
#define DMA_CR_TCIE BIT(4)
#define DMA_CR_TO_PERIPHERAL (1u << 6)
#define DMA_CR_CIRC BIT(8)
#define DMA_CR_MINC BIT(10)
#define DMA_CR_CHANNEL(n) ((uint32_t)(n) << 25)
#define DMA_ALL_FLAGS 0x3Du /* of one stream, before its shift */
#define DMA_TCIF BIT(5)

struct iwdg {
    volatile uint32_t KR, PR, RLR, SR;
};
#define IWDG ((struct iwdg *)0x40003000)
#define IWDG_FEED 0xAAAAu
#define IWDG_UNLOCK 0x5555u
#define IWDG_START 0xCCCCu
#define IWDG_SR_UPDATING 3u

struct pwr {
    volatile uint32_t CR, CSR;
};
#define PWR ((struct pwr *)0x40007000)
#define PWR_CR_PVDE BIT(4)
#define PWR_CR_PLS_HIGHEST (7u << 5)
#define PWR_CSR_PVDO BIT(2)
#define PWR_CR_VOS_SCALE1 (3u << 14) /* F405: bit 15 is reserved and reads 0 */

struct syscfg {
    volatile uint32_t MEMRMP, PMC, EXTICR[4];
};
#define SYSCFG ((struct syscfg *)0x40013800)
#define SYSCFG_EXTICR_PORT_B 1u
#define SYSCFG_EXTICR_PORT_C 2u

struct exti {
    volatile uint32_t IMR, EMR, RTSR, FTSR, SWIER, PR;
};
#define EXTI ((struct exti *)0x40013C00)
#define EXTI_LINE_PVD BIT(16)

/* ---------------------------------------------------------------- core */
struct scb {
    volatile uint32_t CPUID, ICSR, VTOR, AIRCR, SCR, CCR;
    volatile uint8_t SHPR[12];
    volatile uint32_t SHCSR, CFSR, HFSR, DFSR, MMFAR, BFAR;
};
#define SCB ((struct scb *)0xE000ED00)
#define SCB_ICSR_VECTACTIVE 0x1FFu
#define SCB_AIRCR_RESET 0x05FA0004u
#define SCB_SHCSR_FAULTS (7u << 16)
#define SCB_CCR_DIV0 BIT(4)
#define SCB_CFSR_MSTKERR BIT(4)
#define SCB_CFSR_MMARVALID BIT(7)
#define SCB_CFSR_BUS (0xFFu << 8)
#define SCB_CFSR_USAGE (0xFFFFu << 16)

struct nvic {
    volatile uint32_t ISER[8], reserved0[24], ICER[8], reserved1[24], ISPR[8], reserved2[24], ICPR[8], reserved3[24];
    volatile uint32_t IABR[8], reserved4[56];
    volatile uint8_t IPR[240];
};
#define NVIC ((struct nvic *)0xE000E100)

struct mpu {
    volatile uint32_t TYPE, CTRL, RNR, RBAR, RASR;
};
#define MPU ((struct mpu *)0xE000ED90)
#define MPU_CTRL_ENABLE BIT(0)
#define MPU_CTRL_PRIVDEFENA BIT(2)
#define MPU_RASR_ENABLE BIT(0)
#define MPU_RASR_SIZE(log2_bytes) (((log2_bytes) - 1u) << 1)
#define MPU_RASR_NO_ACCESS (0u << 24)
#define MPU_RASR_XN BIT(28)

struct dwt {
    volatile uint32_t CTRL, CYCCNT;
};
#define DWT ((struct dwt *)0xE0001000)
#define DWT_CTRL_CYCCNTENA BIT(0)
#define DEMCR (*(volatile uint32_t *)0xE000EDFC)
#define DEMCR_TRCENA BIT(24)

enum irq { IRQ_PVD = 1, IRQ_DMA1_STREAM6 = 17, IRQ_TIM2 = 28, IRQ_DMA2_STREAM7 = 70, IRQ_COUNT = 97 };

#endif
