# For the toolchain files of Linux boards: one file to copy to the board, whatever its distribution. libgpiod and mbedTLS
# come from Debian packages of the board's architecture, unpacked into build/<architecture> by toolchain/aarch64/fetch.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_C_COMPILER ${WHEELWRIGHT_TRIPLET}-gcc)
set(CMAKE_CXX_COMPILER ${WHEELWRIGHT_TRIPLET}-g++)

get_filename_component(packages ${CMAKE_CURRENT_LIST_DIR}/../../build/${WHEELWRIGHT_DEBIAN_ARCHITECTURE} ABSOLUTE)
if(NOT EXISTS ${packages}/stamp)
    message(FATAL_ERROR "The ${WHEELWRIGHT_DEBIAN_ARCHITECTURE} libraries are not there; run toolchain/aarch64/fetch (see its --help)")
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
        file(CREATE_LINK ${packages}/root/usr/include/${name} ${shared}/${name} SYMBOLIC)
    endif()
endforeach()
set(CMAKE_CXX_STANDARD_INCLUDE_DIRECTORIES ${shared})
set(CMAKE_C_STANDARD_INCLUDE_DIRECTORIES ${shared})
set(CMAKE_INCLUDE_PATH ${shared})
set(CMAKE_LIBRARY_PATH ${packages}/static)
set(CMAKE_FIND_USE_CMAKE_SYSTEM_PATH OFF)
# Locked memory holds the whole program: what nobody calls is left out of it.
string(APPEND CMAKE_CXX_FLAGS_INIT " -ffunction-sections -fdata-sections")  # after the architecture's own
set(CMAKE_EXE_LINKER_FLAGS_INIT "-static -Wl,--gc-sections")
find_program(CMAKE_CROSSCOMPILING_EMULATOR ${WHEELWRIGHT_EMULATOR})  # the package's manual is what its programs say
