wheelwright_test(NAME robot_file
    GROUPS RobotFile RobotFileEdit WriteFile BusPlan KeyFile
    SOURCES robot_file_test.cpp robot_file_edit_test.cpp robot_file_bus_plan_test.cpp key_file_test.cpp
    LIBS wheelwright_robot_file wheelwright_sim)
target_compile_definitions(test_robot_file PRIVATE WHEELWRIGHT_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
