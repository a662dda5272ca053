# 32-bit Arm Linux with a floating-point unit (Debian's armhf), statically linked. Packages: g++-arm-linux-gnueabihf, and what
# toolchain/aarch64/fetch --armhf unpacks into build/armhf.
set(CMAKE_SYSTEM_PROCESSOR arm)
set(WHEELWRIGHT_DEBIAN_ARCHITECTURE armhf)
set(WHEELWRIGHT_TRIPLET arm-linux-gnueabihf)
set(WHEELWRIGHT_EMULATOR qemu-arm)
# Times beyond 2038. GCC 12 sees an overlap in string's operator+ that is not there.
set(CMAKE_CXX_FLAGS_INIT "-D_FILE_OFFSET_BITS=64 -D_TIME_BITS=64 -Wno-restrict")
include(${CMAKE_CURRENT_LIST_DIR}/../cmake/WheelwrightStaticLinux.cmake)
