# Bare Arm Cortex-M7 with a single-precision FPU: the portable core and nothing else. There is no heap, no
# exception, no operating system to fall back on. Packages: gcc-arm-none-eabi, libstdc++-arm-none-eabi-newlib.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_CXX_COMPILER arm-none-eabi-g++)
set(CMAKE_ASM_COMPILER arm-none-eabi-gcc)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY NEVER)

set(machine "-mcpu=cortex-m7 -mthumb -mfpu=fpv5-sp-d16 -mfloat-abi=hard")
set(CMAKE_C_FLAGS_INIT "${machine} -ffunction-sections -fdata-sections")
# Eigen must neither allocate nor print; a double constant in float code would drag in soft-float double.
set(CMAKE_CXX_FLAGS_INIT "${CMAKE_C_FLAGS_INIT} -fno-exceptions -fno-rtti -fno-threadsafe-statics \
-DWHEELWRIGHT_BARE -DEIGEN_NO_MALLOC -DEIGEN_NO_IO -DEIGEN_NO_DEBUG -DEIGEN_DONT_VECTORIZE")
set(CMAKE_EXE_LINKER_FLAGS_INIT "${machine} -nostartfiles --specs=nano.specs --specs=nosys.specs -Wl,--gc-sections")
