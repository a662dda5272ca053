// The file of a black box: a log as candump -L -x writes it, which can-utils read, with comments between the
// frames for what is none. Frames stand in the order of their times; so that the order in which the cycle saw
// them is kept too, each line ends with its place, and where a time matters to the cycle with its
// nanoseconds:
//   (1436509052.249713) can0 021#0011223344556677 R 43012.0 713     received, the first of cycle 43012
//   (1436509052.250013) can0 02E#0000803F00000000 T 43012.3         sent
//   #! (1436509052.250013) can0 04E#0000803F00000000 T 43012.4      the bus did not take it
//   #w 43012.2 0 02E          a frame with this identifier waits still, on bus 0
//   #s 43012.5 0 1 0          statistics: receive overflow, error frames, bus off
//   #> 43012 ...              a cycle: the fields of CycleRecord, and how many of the lines above it has
//   #: key value              about the file: see About
//   #|, #+                    the robot file's text; #+ goes on with the line before
//   #*                        the live parameters at the beginning of what is replayed, to read
//   #=                        the memory, hexadecimal
//   #. lines hash             the end: so many lines above, and FNV-1a of them
// No line is longer than what can-utils take for a comment.
//
// Allocates and throws std::bad_alloc: not for the cycle's thread.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <iosfwd>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/task/black_box.hpp"

namespace wheelwright::task {

// What a box does not know of itself.
struct BoxAbout {
    std::string build;                     // build_identity()
    std::array<std::string, 2> interface;  // the drives', the host's own or ""
    bool stop_line = false, enable_line = false;
    std::int32_t drive_generation = 0;
    std::int64_t offset_ns = 0;  // from the cycle's time to the lines'; whole microseconds
    std::string robot_file;      // its text
};

// False: `write` has refused a piece, nothing more was given to it. `read` hears of each segment that is not
// needed any more.
bool write_black_box(const BlackBox::Record& record, std::size_t memory_bytes, const BoxAbout& about,
                     const std::function<bool(std::string_view)>& write,
                     const std::function<void(std::size_t)>& read);

struct BlackBoxFile {
    BoxAbout about;
    std::string fault;  // its name
    std::uint64_t fault_cycle = 0;
    std::uint64_t first_cycle = 0;  // number of cycles[0]
    std::uint64_t memory_cycle = 0;
    std::vector<std::byte> memory;
    std::vector<BoxCycle> cycles;
    bool as_written = false;  // the hash at the end is right
};

// "" when it can be replayed, else one sentence. A hash that is wrong is no problem here, but for the
// memory's.
std::string read_black_box(std::istream& in, BlackBoxFile& out);

}  // namespace wheelwright::task
