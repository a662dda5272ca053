# cmake -DVERSION=... -DOUT=FILE -P build_identity.cmake LIBRARY...: the source of build_identity(). Static
# libraries have no dates in them, so the same sources, compiler and options give the same hash.
set(hashes "")
math(EXPR last "${CMAKE_ARGC} - 1")
foreach(i RANGE 5 ${last})
    file(SHA256 ${CMAKE_ARGV${i}} hash)
    string(APPEND hashes ${hash})
endforeach()
string(SHA256 hash "${hashes}")
string(SUBSTRING ${hash} 0 16 hash)
file(CONFIGURE OUTPUT ${OUT} @ONLY CONTENT [[
#include "firmware/task/build_identity.hpp"

#include <gnu/libc-version.h>
#include <sys/utsname.h>

namespace wheelwright::task {

std::string build_identity() {
    struct utsname machine {};
    uname(&machine);
    return std::string("@VERSION@ @hash@ gcc-" __VERSION__ " glibc-") + gnu_get_libc_version() + " " +
           machine.machine;
}

}  // namespace wheelwright::task
]])
