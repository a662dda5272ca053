# 64-bit Arm Linux, statically linked: one file to copy to the board, whatever its distribution. Packages:
# g++-aarch64-linux-gnu, and for libgpiod and mbedTLS what toolchain/aarch64/fetch unpacks into build/arm64 (about 70 MB).
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)

get_filename_component(WHEELWRIGHT_ARM64 ${CMAKE_CURRENT_LIST_DIR}/../../build/arm64 ABSOLUTE)
if(NOT EXISTS ${WHEELWRIGHT_ARM64}/stamp)
    message(FATAL_ERROR "The arm64 libraries are not there; run toolchain/aarch64/fetch")
endif()

# Headers that are the same on every machine are taken from this one, but only those: the rest of /usr/include
# belongs to another processor.
set(shared ${CMAKE_BINARY_DIR}/shared-headers)
file(MAKE_DIRECTORY ${shared})
foreach(name eigen3 toml++ CLI nlohmann)
    if(EXISTS /usr/include/${name} AND NOT EXISTS ${shared}/${name})
        file(CREATE_LINK /usr/include/${name} ${shared}/${name} SYMBOLIC)
    endif()
endforeach()
foreach(name gpiod.h gpiod.hpp mbedtls)
    if(NOT EXISTS ${shared}/${name})
        file(CREATE_LINK ${WHEELWRIGHT_ARM64}/root/usr/include/${name} ${shared}/${name} SYMBOLIC)
    endif()
endforeach()
set(CMAKE_CXX_STANDARD_INCLUDE_DIRECTORIES ${shared})
set(CMAKE_C_STANDARD_INCLUDE_DIRECTORIES ${shared})
set(CMAKE_INCLUDE_PATH ${shared})
set(CMAKE_LIBRARY_PATH ${WHEELWRIGHT_ARM64}/static)
set(CMAKE_FIND_USE_CMAKE_SYSTEM_PATH OFF)
set(CMAKE_EXE_LINKER_FLAGS_INIT "-static")
