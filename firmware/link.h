/* The host's words and our answers. */
#ifndef LINK_H
#define LINK_H

#include <stdint.h>

/* Takes what was received, and sends what is to be sent, as far as the port has room; returns 1 where something waits for room. */
uint8_t link_poll(void);

#endif
