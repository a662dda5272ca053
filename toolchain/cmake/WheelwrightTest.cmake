# Tests. Every CppUTest group, script and page check is one ctest test.

# Debian's CppUTest CMake package is broken (wrong prefix), so it is found by path.
find_path(CPPUTEST_INCLUDE_DIR CppUTest/TestHarness.h REQUIRED)
find_library(CPPUTEST_LIBRARY CppUTest REQUIRED)
find_library(CPPUTEST_EXT_LIBRARY CppUTestExt REQUIRED)
add_library(wheelwright_cpputest INTERFACE)
target_include_directories(wheelwright_cpputest SYSTEM INTERFACE ${CPPUTEST_INCLUDE_DIR})
target_link_libraries(wheelwright_cpputest INTERFACE ${CPPUTEST_EXT_LIBRARY} ${CPPUTEST_LIBRARY})

# wheelwright_test(NAME <exe> GROUPS <group>... SOURCES <file>... [LIBS <target>...] [TIMEOUT s] [LABELS l...])
# builds test_<exe> and registers each group as the ctest test <exe>.<group>. A further test fails when the
# binary holds a group that is not registered, so no test can be forgotten.
function(wheelwright_test)
    cmake_parse_arguments(ARG "" "NAME;TIMEOUT" "GROUPS;SOURCES;LIBS;LABELS" ${ARGN})
    if(NOT ARG_TIMEOUT)
        set(ARG_TIMEOUT 300)
    endif()
    set(exe test_${ARG_NAME})
    add_executable(${exe} ${ARG_SOURCES} ${CMAKE_SOURCE_DIR}/tests/support/main.cpp)
    target_link_libraries(${exe} PRIVATE ${ARG_LIBS} wheelwright_options wheelwright_eigen wheelwright_cpputest)
    set_target_properties(${exe} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
    foreach(group ${ARG_GROUPS})
        add_test(NAME ${ARG_NAME}.${group} COMMAND ${exe} -sg ${group} -v)
        set_tests_properties(${ARG_NAME}.${group} PROPERTIES
            TIMEOUT ${ARG_TIMEOUT} LABELS "${ARG_LABELS}"
            FAIL_REGULAR_EXPRESSION "OK \\(0 tests|, 0 ran,")
    endforeach()
    list(JOIN ARG_GROUPS " " groups)
    add_test(NAME ${ARG_NAME}.all_groups_registered
        COMMAND ${CMAKE_SOURCE_DIR}/tests/support/check_groups $<TARGET_FILE:${exe}> ${ARG_GROUPS})
endfunction()

# wheelwright_script_test(NAME <name> COMMAND <command>... [TIMEOUT s] [LABELS l...] [ENVIRONMENT VAR=value...])
function(wheelwright_script_test)
    cmake_parse_arguments(ARG "" "NAME;TIMEOUT" "COMMAND;LABELS;ENVIRONMENT" ${ARGN})
    if(NOT ARG_TIMEOUT)
        set(ARG_TIMEOUT 300)
    endif()
    add_test(NAME ${ARG_NAME} COMMAND ${ARG_COMMAND})
    set_tests_properties(${ARG_NAME} PROPERTIES TIMEOUT ${ARG_TIMEOUT} LABELS "${ARG_LABELS}"
        ENVIRONMENT "${ARG_ENVIRONMENT}")
endfunction()
