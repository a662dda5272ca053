// For toolchain/qemu/run-rt --icount: a program that takes all the time nobody else wants (SCHED_IDLE), so that
// the emulated processor never waits. While it waits, QEMU moves its clock from another thread, and about once in
// 100 000 waits that happens a few hundred instructions early or late, depending on how loaded this machine is.
    .global _start
_start:
    mov     x0, #0              // itself
    mov     x1, #5              // SCHED_IDLE
    adr     x2, priority
    mov     x8, #119            // sched_setscheduler
    svc     #0
    cbnz    x0, failed
loop:
    .rept   1000
    nop
    .endr
    b       loop
failed:
    mov     x0, #1
    mov     x8, #93             // exit
    svc     #0
priority:
    .word   0
