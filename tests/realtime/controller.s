// What outside.py puts at the entry of a CAN driver's read_reg(priv, register) of an SJA1000: asked by its interrupt handler, one
// controller tells other causes and another status than it has, once. With `reset` it does as when it goes off the bus: instead of
// telling that it has sent a frame, so the driver gives it no other one; it goes into reset mode, and its receive queue is empty.
// Symbols: interface (its name, 4 characters), read and write (the driver's functions), handler and handler_size, armed (of a
// byte, which is 1), causes, status, reset (1 or 0).
        .equ MODE, 0
        .equ COMMAND, 1
        .equ STATUS, 2
        .equ INTERRUPT, 3
        .equ RESET, 1
        .equ RELEASE, 4         // the oldest frame received
        .equ RECEIVED_BIT, 0    // of the status
        .equ SENT_BIT, 1        // of the causes

        .macro truly function, port, value=0
        ldr     x0, [sp, 16]
        mov     w1, \port
        mov     w2, \value
        ldr     x16, =\function
        blr     x16
        .endm

        ldr     x16, [x0]       // of priv the net_device comes first, and of that its name
        ldr     w16, [x16]
        ldr     w17, =interface
        cmp     w16, w17
        b.ne    as_ever
        ldr     x16, =handler
        sub     x16, x30, x16
        ldr     x17, =handler_size
        cmp     x16, x17
        b.hs    as_ever         // another one asks, who may have preempted the handler
        ldr     x16, =armed
        ldrb    w17, [x16]
        cmp     w17, 1
        b.ne    second
        cmp     w1, INTERRUPT
        b.ne    as_ever
        .if reset
        stp     x29, x30, [sp, -32]!
        str     x0, [sp, 16]
        truly   read + 4, INTERRUPT
        ldp     x29, x30, [sp], 32
        tbz     w0, SENT_BIT, told
        .endif
        ldr     x16, =armed
        mov     w17, 2
        strb    w17, [x16]
        mov     w0, causes
told:   ret
second: cmp     w17, 2
        b.ne    as_ever
        cmp     w1, STATUS
        b.ne    as_ever
        strb    wzr, [x16]
        .if reset
        stp     x29, x30, [sp, -32]!
        str     x0, [sp, 16]
        truly   write, MODE, RESET
empty:  truly   write, COMMAND, RELEASE
        truly   read + 4, STATUS
        tbnz    w0, RECEIVED_BIT, empty
        ldp     x29, x30, [sp], 32
        .endif
        mov     w0, status
        ret
as_ever:
        ldr     x16, =read + 4
        br      x16
