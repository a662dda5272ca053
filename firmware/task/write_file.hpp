// Writing a file so that a crash or a power cut leaves either the old text or the new one, never a part.
#pragma once

#include <functional>
#include <string>
#include <string_view>

namespace wheelwright::task {

// Replaces the contents of `path` by `text`: temporary file in the same directory, fsync, rename, fsync of
// the directory. A symbolic link stays one; permissions are kept, the owner where the system allows it. A
// file that does not exist is made. Waits for the disk: never call it from the cycle's thread. Returns ""
// when done, else one sentence saying what failed; the old file is then untouched.
std::string write_whole_file(const std::string& path, std::string_view text);

// The same for a text that comes in pieces: `produce` gives them to the function that it is given, which says
// false when the disk takes no more. That file is not there, or as it was, until it is whole.
using Pieces = std::function<bool(std::string_view)>;
std::string write_whole_file(const std::string& path, const std::function<bool(const Pieces&)>& produce);

// Reads a regular file of at most 16 MiB; does not wait for anybody. Returns "" when done, else one sentence
// saying what failed.
std::string read_whole_file(const std::string& path, std::string& text);

}  // namespace wheelwright::task
