// Which build of the firmware this is, exactly enough to know whether a cycle of one program is a cycle of
// another: version, a hash of the libraries that the cycle is made of, and the compiler, C library and
// machine under them.
#pragma once

#include <string>

namespace wheelwright::task {

std::string
build_identity();  // "0.1.0 f7f7f2f1a1b2c3d4 gcc-12.2.0 glibc-2.36 x86_64", no blanks within its parts

}  // namespace wheelwright::task
