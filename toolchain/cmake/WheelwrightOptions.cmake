# Compiler flags for every target of the project. `wheelwright_options` carries warnings and the sanitizers;
# `wheelwright_core_options` adds what the portable core must live without.
add_library(wheelwright_options INTERFACE)
if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)  # the judge of warnings; clang's -Wconversion means more
    target_compile_options(wheelwright_options INTERFACE
        -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Werror)
endif()
target_include_directories(wheelwright_options INTERFACE
    ${CMAKE_SOURCE_DIR} ${CMAKE_BINARY_DIR}/generated)
if(WHEELWRIGHT_SANITIZE)
    # Of the undefined-behaviour checks all but two that the address sanitizer makes unneeded, null and object-size,
    # and alignment, which the core alone has (below): what parses bytes of frames is there. The three are checks of
    # every access, a third of the time to compile what uses Eigen.
    target_compile_options(wheelwright_options INTERFACE
        -fsanitize=address -fno-sanitize-recover=all -fno-omit-frame-pointer
        -fsanitize=shift,integer-divide-by-zero,unreachable,vla-bound,return,signed-integer-overflow,bounds
        -fsanitize=bool,enum,pointer-overflow,builtin,nonnull-attribute,returns-nonnull-attribute)
    # Not vptr: clang needs run-time types for it, and the core has none.
    target_link_options(wheelwright_options INTERFACE -fsanitize=address,undefined)
    # For libFuzzer, which guides itself by it.
    target_compile_options(wheelwright_options INTERFACE -fsanitize=fuzzer-no-link)
    # Tests that repeat one thing for statistics' sake repeat it less often.
    target_compile_definitions(wheelwright_options INTERFACE WHEELWRIGHT_SANITIZED)
endif()

add_library(wheelwright_core_options INTERFACE)
target_link_libraries(wheelwright_core_options INTERFACE wheelwright_options)
target_compile_options(wheelwright_core_options INTERFACE
    $<$<COMPILE_LANGUAGE:CXX>:-fno-exceptions -fno-rtti>)
if(WHEELWRIGHT_SANITIZE)
    target_compile_options(wheelwright_core_options INTERFACE -fsanitize=alignment)
endif()

find_program(WHEELWRIGHT_CCACHE ccache)
if(WHEELWRIGHT_CCACHE)  # what another clone of the project has compiled counts too
    set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_BASEDIR=${CMAKE_SOURCE_DIR} CCACHE_NOHASHDIR=1
        ${WHEELWRIGHT_CCACHE})
endif()

# Eigen is a SYSTEM include, so that our warnings stay ours.
find_path(WHEELWRIGHT_EIGEN_DIR Eigen/Core PATHS /usr/include PATH_SUFFIXES eigen3 REQUIRED)
add_library(wheelwright_eigen INTERFACE)
target_include_directories(wheelwright_eigen SYSTEM INTERFACE ${WHEELWRIGHT_EIGEN_DIR})
