# The drives' frames. On the bus the id is node << 5 | command.
include(WheelwrightDbc)
foreach(generation 0_5 0_6)
    wheelwright_dbc(
        DBC ${CMAKE_CURRENT_LIST_DIR}/odrive_${generation}.dbc
        HEADER drivers/odrive/odrive_${generation}_messages.hpp
        NAMESPACE wheelwright::drivers::odrive_${generation}
        ID_NAME command)
endforeach()
