# C++ codecs from DBC files. The interpreter is the system's: python3-canmatrix belongs to it.
set(WHEELWRIGHT_PYTHON /usr/bin/python3 CACHE FILEPATH "Python that has canmatrix (Debian: python3-canmatrix)")
if(NOT WHEELWRIGHT_CANMATRIX_FOUND)
    execute_process(COMMAND ${WHEELWRIGHT_PYTHON} -c "import canmatrix.formats"
        RESULT_VARIABLE result OUTPUT_QUIET ERROR_QUIET)
    if(NOT result EQUAL 0)
        message(FATAL_ERROR "${WHEELWRIGHT_PYTHON} cannot import canmatrix: install python3-canmatrix")
    endif()
    set(WHEELWRIGHT_CANMATRIX_FOUND TRUE CACHE INTERNAL "")
endif()

# All generated headers; whatever includes one depends on this target (what links wheelwright_core already does).
if(NOT TARGET wheelwright_generated)
    add_custom_target(wheelwright_generated)
endif()

# wheelwright_dbc(DBC <file> HEADER <path> NAMESPACE <ns> [ID_NAME <name>])
# generates ${CMAKE_BINARY_DIR}/generated/<path>, included as <path>.
function(wheelwright_dbc)
    cmake_parse_arguments(ARG "" "DBC;HEADER;NAMESPACE;ID_NAME" "" ${ARGN})
    if(NOT ARG_ID_NAME)
        set(ARG_ID_NAME id)
    endif()
    cmake_path(ABSOLUTE_PATH ARG_DBC BASE_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR})
    set(generator ${CMAKE_SOURCE_DIR}/toolchain/dbc_codegen/generate.py)
    set(header ${CMAKE_BINARY_DIR}/generated/${ARG_HEADER})
    add_custom_command(OUTPUT ${header}
        COMMAND ${WHEELWRIGHT_PYTHON} ${generator} ${ARG_DBC} ${header}
            --namespace ${ARG_NAMESPACE} --id-name ${ARG_ID_NAME}
        DEPENDS ${ARG_DBC} ${generator}
        COMMENT "Generating ${ARG_HEADER}"
        VERBATIM)
    string(MAKE_C_IDENTIFIER generated_${ARG_HEADER} target)
    add_custom_target(${target} DEPENDS ${header})
    add_dependencies(wheelwright_generated ${target})
endfunction()
