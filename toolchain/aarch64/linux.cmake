# 64-bit Arm Linux, statically linked. Packages: g++-aarch64-linux-gnu, and what toolchain/aarch64/fetch unpacks into
# build/arm64 (about 70 MB).
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(WHEELWRIGHT_DEBIAN_ARCHITECTURE arm64)
set(WHEELWRIGHT_TRIPLET aarch64-linux-gnu)
set(WHEELWRIGHT_EMULATOR qemu-aarch64)
include(${CMAKE_CURRENT_LIST_DIR}/../cmake/WheelwrightStaticLinux.cmake)
