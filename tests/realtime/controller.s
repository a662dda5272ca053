// What outside.py puts at the entry of a CAN driver's read_reg(priv, port) of an SJA1000: asked by its interrupt handler, one
// controller tells other causes and another status than it has, once, and may go into reset mode, as it does when off the bus.
// Symbols: interface (its name, 4 characters), read and write (the driver's functions), handler and handler_size, armed (of a
// byte, which is 1), causes, status, reset (1 or 0).
        .equ STATUS, 2
        .equ INTERRUPT, 3

        ldr     x16, [x0]               // of priv the net_device comes first, and of that its name
        ldr     w16, [x16]
        ldr     w17, =interface
        cmp     w16, w17
        b.ne    as_ever
        ldr     x16, =handler
        sub     x16, x30, x16
        ldr     x17, =handler_size
        cmp     x16, x17
        b.hs    as_ever                 // another one asks, who may have preempted the handler
        ldr     x16, =armed
        ldrb    w17, [x16]
        cmp     w17, 1
        b.ne    second
        cmp     w1, INTERRUPT
        b.ne    as_ever
        mov     w17, 2
        strb    w17, [x16]
        mov     w0, causes
        ret
second: cmp     w17, 2
        b.ne    as_ever
        cmp     w1, STATUS
        b.ne    as_ever
        strb    wzr, [x16]
        .if reset
        stp     x29, x30, [sp, -16]!
        mov     w1, 0
        mov     w2, 1
        ldr     x16, =write
        blr     x16
        ldp     x29, x30, [sp], 16
        .endif
        mov     w0, status
        ret
as_ever:
        ldr     x16, =read + 4
        br      x16
