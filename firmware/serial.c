#include "serial.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#define RECEIVE_SIZE 128
#define SEND_SIZE 256 /* the index is a byte, and wraps by itself */

static volatile uint8_t received[RECEIVE_SIZE], receive_head, receive_tail;
static volatile uint8_t sent[SEND_SIZE], send_head, send_tail;
static volatile uint16_t lost;

void serial_init(void) {
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UBRR0 = (uint16_t)((F_CPU + BAUD * 4) / (BAUD * 8) - 1);
    UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
}

ISR(USART_RX_vect) {
    uint8_t overrun = UCSR0A & _BV(DOR0);
    uint8_t byte = UDR0;
    uint8_t next = (receive_head + 1) & (RECEIVE_SIZE - 1);
    if (overrun || next == receive_tail)
        lost++;
    if (next != receive_tail) {
        received[receive_head] = byte;
        receive_head = next;
    }
}

ISR(USART_UDRE_vect) {
    if (send_head == send_tail)
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
    else
        UDR0 = sent[send_tail++];
}

int16_t serial_take(void) {
    uint8_t tail = receive_tail;
    if (tail == receive_head)
        return -1;
    uint8_t byte = received[tail];
    receive_tail = (tail + 1) & (RECEIVE_SIZE - 1);
    return byte;
}

uint8_t serial_is_empty(void) { return receive_tail == receive_head; }

uint8_t serial_send(const uint8_t *frame, uint8_t length, uint8_t spare) {
    uint8_t head = send_head;
    uint8_t room = (uint8_t)(send_tail - head - 1);
    if (room < length || room - length < spare)
        return 0;
    while (length--)
        sent[head++] = *frame++;
    send_head = head;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { UCSR0B |= _BV(UDRIE0); }
    return 1;
}

uint16_t serial_lost(void) {
    uint16_t found;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { found = lost; }
    return found;
}
