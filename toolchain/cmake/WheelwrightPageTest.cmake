# wheelwright_page_test(NAME <name> PAGE <file.html> FIXTURE <ctest fixture that writes it>)
# opens a page in headless Chromium at phone and desktop width, in light and dark, and checks it.
function(wheelwright_page_test)
    cmake_parse_arguments(ARG "" "NAME;PAGE;FIXTURE" "" ${ARGN})
    wheelwright_script_test(NAME ${ARG_NAME}.in_browser TIMEOUT 120
        COMMAND ${WHEELWRIGHT_PYTHON} ${CMAKE_SOURCE_DIR}/tests/pages/check_page.py ${ARG_PAGE}
            --screenshots ${CMAKE_BINARY_DIR}/screenshots/${ARG_NAME})
    set_tests_properties(${ARG_NAME}.in_browser PROPERTIES FIXTURES_REQUIRED ${ARG_FIXTURE})
endfunction()
