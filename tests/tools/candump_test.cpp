// candump -L lines: what is read, what is refused, and that the same bytes come out again.
#include <cstdio>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "tools/logs/candump.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using tools::LogFrame;

namespace {

LogFrame parse(const std::string& line) {
    LogFrame entry;
    STRCMP_EQUAL("", tools::parse_candump_line(line, entry).c_str());
    return entry;
}

void expect_refused(const std::string& line, const std::string& why) {
    LogFrame entry;
    const std::string said = tools::parse_candump_line(line, entry);
    CHECK_TEXT(said.find(why) != std::string::npos, (line + ": " + said).c_str());
}

}  // namespace

TEST_GROUP(Candump){};

TEST(Candump, EveryKindOfFrameIsUnderstood) {
    const LogFrame data = parse("(1436509052.249713) vcan0 624#2C01F4012C01F401");
    CHECK(data.time_ns == 1436509052249713000);
    STRCMP_EQUAL("vcan0", data.interface.c_str());
    LONGS_EQUAL(0x624, data.frame.id);
    LONGS_EQUAL(8, data.frame.length);
    LONGS_EQUAL(0x2C, data.frame.data[0]);
    LONGS_EQUAL(0x01, data.frame.data[7]);
    CHECK_FALSE(data.frame.extended || data.frame.fd || data.frame.remote || data.frame.error);

    CHECK(parse("(0000000000.000001) can0 0001ABCD#").frame.extended);
    LONGS_EQUAL(0x1FFFFFFF, parse("(1.5) can0 1FFFFFFF#00").frame.id);
    CHECK(parse("(1.5) can0 1FFFFFFF#00").time_ns == 1500000000);
    const LogFrame remote = parse("(0000000001.000000) can0 123#R4");
    CHECK(remote.frame.remote);
    LONGS_EQUAL(4, remote.frame.length);
    const LogFrame error = parse("(0000000001.000000) can0 20000080#0000000000000000");
    CHECK(error.frame.error);
    LONGS_EQUAL(0x80, error.frame.id);
    const LogFrame fd = parse("(0000000001.000000) can0 123##5000102030405060708090A0B");
    CHECK(fd.frame.fd && fd.frame.bit_rate_switch);
    LONGS_EQUAL(12, fd.frame.length);
    LONGS_EQUAL(5, fd.fd_flags);
}

// Lines as candump 2020.11 writes them, and two of newer versions.
TEST(Candump, LinesComeOutAsTheyWentIn) {
    for (const char* line : {
             "(1436509052.249713) vcan0 624#2C01F4012C01F401",
             "(0000000000.000001) can0 000#",
             "(0000000001.000000) can0 7FF#R",
             "(0000000001.000000) can0 123#R8",
             "(0000000001.000000) can0 1FFFFFFF#DEADBEEF",
             "(0000000001.000000) can0 00000001#01",
             "(0000000001.000000) slcan12 20000004#0010000000000000",
             "(1700000000.999999) can0 123##0",
             "(1700000000.999999) can0 123##1AABB",
             "(1700000000.999999) can0 12345678##5000102030405060708090A0B",
             "(0000000001.000000) can0 123#1122334455667788_E",
             "(0000000001.000000) can0 123#11 R",
         }) {
        STRCMP_EQUAL(line, tools::format_candump_line(parse(line)).c_str());
    }
}

TEST(Candump, RandomFramesSurviveARoundTrip) {
    std::mt19937 random(11);
    constexpr std::array<unsigned, 16> fd_lengths{0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    for (int i = 0; i < 3000; ++i) {
        LogFrame out;
        out.time_ns = static_cast<std::int64_t>(random()) * 1'000'000;
        hal::CanFrame& frame = out.frame;
        frame.extended = random() % 2 == 0;
        frame.id = static_cast<std::uint32_t>(random()) & (frame.extended ? 0x1FFFFFFFU : 0x7FFU);
        frame.fd = random() % 3 == 0;
        frame.remote = !frame.fd && random() % 5 == 0;
        frame.length =
            static_cast<std::uint8_t>(frame.fd ? fd_lengths.at(random() % fd_lengths.size()) : random() % 9);
        frame.bit_rate_switch = frame.fd && random() % 2 == 0;
        for (std::uint8_t& byte : frame.data) byte = static_cast<std::uint8_t>(random());
        const LogFrame in = parse(tools::format_candump_line(out));
        CHECK(in.time_ns == out.time_ns);
        LONGS_EQUAL(frame.id, in.frame.id);
        LONGS_EQUAL(frame.length, in.frame.length);
        CHECK(in.frame.extended == frame.extended && in.frame.fd == frame.fd &&
              in.frame.remote == frame.remote && in.frame.bit_rate_switch == frame.bit_rate_switch);
        for (std::size_t b = 0; !frame.remote && b < frame.length; ++b) {
            LONGS_EQUAL(frame.data[b], in.frame.data[b]);
        }
    }
}

TEST(Candump, BadLinesAreRefusedWithTheReason) {
    expect_refused("can0 123#00", "does not begin with (time)");
    expect_refused("(12.000000 can0 123#00", "does not begin with (time)");
    expect_refused("(x.000000) can0 123#00", "time is not");
    expect_refused("(12) can0 123#00", "time is not");
    expect_refused("(12.0000000001) can0 123#00", "time is not");
    expect_refused("(-1.000000) can0 123#00", "time is not");
    expect_refused("(12.000000)can0 123#00", "no space");
    expect_refused("(12.000000) can0", "missing");
    expect_refused("(12.000000) can0 123", "no #");
    expect_refused("(12.000000) can0 12#00", "neither 3 nor 8");
    expect_refused("(12.000000) can0 800#00", "above 7FF");
    expect_refused("(12.000000) can0 1G3#00", "not hexadecimal");
    expect_refused("(12.000000) can0 40000000#00", "above 1FFFFFFF");
    expect_refused("(12.000000) can0 123#0", "middle of a byte");
    expect_refused("(12.000000) can0 123#0G", "middle of a byte");
    expect_refused("(12.000000) can0 123#00G0", "not hexadecimal");
    expect_refused("(12.000000) can0 123#001122334455667788", "more than 8");
    expect_refused("(12.000000) can0 123#R9", "more than 8");
    expect_refused("(12.000000) can0 123##", "flags");
    expect_refused("(12.000000) can0 123##0000000000000000000", "cannot have 9");
    expect_refused("(12.000000) can0 123#11_9", "length code");
}

TEST(Candump, AReaderGoesOnBehindBadLinesAndCountsThem) {
    std::istringstream in(
        "(1.000000) can0 123#00\r\n\n(0.900000) can0 123#01\nnonsense\n(1.000000) can0 123#02\n(2.0) can0 "
        "123#03");
    const tools::CandumpLog log = tools::read_candump(in);
    LONGS_EQUAL(3, log.frames.size());
    LONGS_EQUAL(2, log.bad_lines);
    LONGS_EQUAL(3, log.problems[0].line);
    STRCMP_EQUAL("log:3: time goes back by 100000 microseconds", to_text("log", log.problems[0]).c_str());
    LONGS_EQUAL(4, log.problems[1].line);
    LONGS_EQUAL(3, log.frames[2].frame.data[0]);
}

TEST(Candump, RandomTextIsNeverAFrameByAccidentThatDoesNotWriteBack) {
    std::mt19937 random(5);
    const std::string base = "(1436509052.249713) vcan0 624#2C01F4012C01F401";
    unsigned good = 0;
    for (int i = 0; i < 20000; ++i) {
        std::string line = base;
        line[random() % line.size()] = static_cast<char>(32 + random() % 95);
        LogFrame entry;
        if (!tools::parse_candump_line(line, entry).empty()) continue;
        ++good;
        const std::string again = tools::format_candump_line(entry);
        LogFrame twice;
        STRCMP_EQUAL("", tools::parse_candump_line(again, twice).c_str());
        STRCMP_EQUAL(again.c_str(), tools::format_candump_line(twice).c_str());
    }
    std::printf("%u of 20000 changed lines were still frames\n", good);
}
