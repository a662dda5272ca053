# Tests. Every CppUTest group, script and page check is one ctest test.

# Debian's CppUTest CMake package is broken (wrong prefix), so it is found by path.
find_path(CPPUTEST_INCLUDE_DIR CppUTest/TestHarness.h REQUIRED)
find_library(CPPUTEST_LIBRARY CppUTest REQUIRED)
find_library(CPPUTEST_EXT_LIBRARY CppUTestExt REQUIRED)
add_library(wheelwright_cpputest INTERFACE)
target_include_directories(wheelwright_cpputest SYSTEM INTERFACE ${CPPUTEST_INCLUDE_DIR})
target_link_libraries(wheelwright_cpputest INTERFACE ${CPPUTEST_EXT_LIBRARY} ${CPPUTEST_LIBRARY})

# All test binaries that also run under the sanitizers.
add_custom_target(wheelwright_sanitized_tests)

# A limit ends what hangs; it is no measure of speed, and a busy machine is slow: four times what a quiet one is given.
function(wheelwright_time_limit variable seconds)
    if(NOT seconds)
        set(seconds 300)
    endif()
    math(EXPR limit "${seconds} * 4")
    set(${variable} ${limit} PARENT_SCOPE)
endfunction()

# wheelwright_test(NAME <name> GROUPS <group>... SOURCES <file>... [LIBS <target>...] [TIMEOUT s] [LABELS l...]
#                  [NO_SANITIZE])
# builds test_<name> and registers each group as the ctest test <name>.<group>. A further test fails when the
# binary holds a group that is not registered, so no test can be forgotten. With WHEELWRIGHT_SLOW_TESTS the
# test sanitized.<name> runs the whole binary built by the preset `sanitize`, unless NO_SANITIZE is given: for
# long campaigns over code that a shorter test covers, and for what a sanitizer itself would disturb.
function(wheelwright_test)
    cmake_parse_arguments(ARG "NO_SANITIZE" "NAME;TIMEOUT" "GROUPS;SOURCES;LIBS;LABELS" ${ARGN})
    wheelwright_time_limit(ARG_TIMEOUT "${ARG_TIMEOUT}")
    set(exe test_${ARG_NAME})
    add_executable(${exe} ${ARG_SOURCES} ${CMAKE_SOURCE_DIR}/tests/support/main.cpp)
    target_link_libraries(${exe} PRIVATE ${ARG_LIBS} wheelwright_options wheelwright_eigen wheelwright_cpputest)
    # The libraries that are tested stay as optimised as they are. A test's own code, and the templates that it
    # instantiates, cost more time to optimise than they take to run.
    target_compile_options(${exe} PRIVATE $<$<CONFIG:Release>:-O1>)
    set_target_properties(${exe} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
    foreach(group ${ARG_GROUPS})
        add_test(NAME ${ARG_NAME}.${group} COMMAND ${exe} -sg ${group} -v)
        set_tests_properties(${ARG_NAME}.${group} PROPERTIES
            TIMEOUT ${ARG_TIMEOUT} LABELS "${ARG_LABELS}"
            FAIL_REGULAR_EXPRESSION "OK \\(0 tests|, 0 ran,")
    endforeach()
    add_test(NAME ${ARG_NAME}.all_groups_registered
        COMMAND ${CMAKE_SOURCE_DIR}/tests/support/check_groups $<TARGET_FILE:${exe}> ${ARG_GROUPS})

    if(NOT ARG_NO_SANITIZE)
        add_dependencies(wheelwright_sanitized_tests ${exe})
        if(WHEELWRIGHT_SLOW_TESTS AND NOT WHEELWRIGHT_SANITIZE)
            math(EXPR timeout "${ARG_TIMEOUT} * 2")
            add_test(NAME sanitized.${ARG_NAME} COMMAND ${CMAKE_BINARY_DIR}/sanitize/tests/${exe} -v)
            set_tests_properties(sanitized.${ARG_NAME} PROPERTIES
                TIMEOUT ${timeout} LABELS "sanitize;${ARG_LABELS}" FIXTURES_REQUIRED sanitized_tests)
        endif()
    endif()
endfunction()

# wheelwright_script_test(NAME <name> COMMAND <command>... [TIMEOUT s] [LABELS l...] [ENVIRONMENT VAR=value...])
function(wheelwright_script_test)
    cmake_parse_arguments(ARG "" "NAME;TIMEOUT" "COMMAND;LABELS;ENVIRONMENT" ${ARGN})
    wheelwright_time_limit(ARG_TIMEOUT "${ARG_TIMEOUT}")
    add_test(NAME ${ARG_NAME} COMMAND ${ARG_COMMAND})
    set_tests_properties(${ARG_NAME} PROPERTIES TIMEOUT ${ARG_TIMEOUT} LABELS "${ARG_LABELS}"
        ENVIRONMENT "${ARG_ENVIRONMENT}")
endfunction()

# wheelwright_build_fixture(FIXTURE <fixture> NAME <test> PRESET <preset> DIR <directory> [TARGETS <target>...])
# registers a test that configures and builds a preset in DIR; tests with FIXTURES_REQUIRED <fixture> run after it.
# It takes all processors.
function(wheelwright_build_fixture)
    cmake_parse_arguments(ARG "" "FIXTURE;NAME;PRESET;DIR" "TARGETS" ${ARGN})
    include(ProcessorCount)
    ProcessorCount(processors)
    add_test(NAME ${ARG_NAME}
        COMMAND ${CMAKE_SOURCE_DIR}/tests/support/build_preset ${ARG_PRESET} ${ARG_DIR} ${ARG_TARGETS}
        WORKING_DIRECTORY ${CMAKE_SOURCE_DIR})
    set_tests_properties(${ARG_NAME} PROPERTIES
        FIXTURES_SETUP ${ARG_FIXTURE} TIMEOUT 3600 PROCESSORS ${processors})
endfunction()

# wheelwright_measured_data(<variable>) sets the variable to the folder of measured logs, that is to
# WHEELWRIGHT_DATA of the environment at configuration, or to nothing. Register tests on those logs only when it
# is not empty. They must fail, not skip, when a log is absent: a folder that was named and is wrong is an error.
function(wheelwright_measured_data variable)
    set(${variable} "$ENV{WHEELWRIGHT_DATA}" PARENT_SCOPE)
endfunction()
