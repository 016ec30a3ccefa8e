/* The host's words and our answers. */
#ifndef LINK_H
#define LINK_H

/* Takes what was received, and sends what is to be sent, as far as the port has room. */
void link_poll(void);

#endif
