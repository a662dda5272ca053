// The reference of the robot file as a Markdown page, made from the tables that read it.
#pragma once

#include <string>

namespace wheelwright::tools {

std::string parameter_reference();

}  // namespace wheelwright::tools
