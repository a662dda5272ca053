// Reports for people and programs, and frames as text.
#include <cmath>
#include <string>

#include "firmware/protocol/command_guard.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"
#include "tools/cli/message_text.hpp"
#include "tools/cli/parameter_names.hpp"
#include "tools/cli/report.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

TEST_GROUP(Report){};

TEST(Report, TextIsAlignedAndJsonHasTheSameFigures) {
    tools::Report report("example");
    report.section("loop", "Loop");
    report.add("settling_time_s", "settling time", 0.0412, "s", "aim 0.05");
    report.add("größe", "Größe", std::int64_t{12});
    report.add("ok", "good", true);
    report.add("broken", "broken", std::nan(""));
    report.table("steps", {{"name", "step"}, {"error_m", "error, m"}});
    report.row({std::string("first"), 0.25});
    report.row({std::string("the second"), -1.5});
    STRCMP_EQUAL(
        "Loop\n"
        "  settling time  0.0412 s  (aim 0.05)\n"
        "  Größe              12\n"
        "  good           yes\n"
        "  broken            nan\n"
        "\n"
        "  step        error, m\n"
        "  first           0.25\n"
        "  the second      -1.5\n",
        report.text().c_str());
    STRCMP_EQUAL(
        "{\n  \"command\": \"example\",\n  \"loop\": {\n    \"settling_time_s\": 0.0412,\n"
        "    \"größe\": 12,\n    \"ok\": true,\n    \"broken\": null,\n    \"steps\": [\n"
        "      {\n        \"name\": \"first\",\n        \"error_m\": 0.25\n      },\n"
        "      {\n        \"name\": \"the second\",\n        \"error_m\": -1.5\n      }\n    ]\n  }\n}\n",
        report.json().c_str());
}

TEST(Report, EmptyTablesAreShownToProgramsOnly) {
    tools::Report report("example");
    report.section("notes", "Notes");
    report.table("list", {{"key", "key"}});
    STRCMP_EQUAL("", report.text().c_str());
    STRCMP_EQUAL("{\n  \"command\": \"example\",\n  \"notes\": {\n    \"list\": []\n  }\n}\n",
                 report.json().c_str());
}

TEST(Report, ParametersAreFoundByKeyAndByNumber) {
    const auto by_key = tools::find_named_parameter("geometry.track_m");
    CHECK(by_key.has_value());
    LONGS_EQUAL(0x0003, by_key->index);
    STRCMP_EQUAL("geometry.track_m", tools::find_named_parameter("0x0003")->key.c_str());
    STRCMP_EQUAL("geometry.track_m", tools::find_named_parameter("3")->key.c_str());
    STRCMP_EQUAL("effects.coulomb_friction.right_Nm", tools::find_named_parameter("0x4011")->key.c_str());
    CHECK_FALSE(tools::find_named_parameter("track_m").has_value());
    CHECK_FALSE(tools::find_named_parameter("0x0004").has_value());
    CHECK_FALSE(tools::find_named_parameter("").has_value());
    std::string expected;
    const auto reaction = tools::find_named_parameter("safety.overrun_reaction");
    DOUBLES_EQUAL(1, *tools::parse_parameter_value(*reaction, "ramp", expected), 0);
    CHECK_FALSE(tools::parse_parameter_value(*reaction, "1", expected).has_value());
    STRCMP_EQUAL("coast or ramp", expected.c_str());
    CHECK_FALSE(tools::parse_parameter_value(*by_key, "nan", expected).has_value());
    CHECK_FALSE(tools::parse_parameter_value(*by_key, "9", expected).has_value());
    STRCMP_EQUAL("a number from 0.02 to 5 m", expected.c_str());
}

TEST_GROUP(MessageText){};

TEST(MessageText, FramesAreToldWithNamesUnitsAndTheirDecimals) {
    protocol::BodyState state;
    state.forward_speed_m_per_s = -0.1505;
    state.yaw_rate_rad_per_s = 0.7;
    hal::CanFrame frame;
    frame.id = protocol::BodyState::id;
    frame.length = protocol::BodyState::length;
    CHECK(state.encode(std::span(frame.data)) == protocol::CodecStatus::ok);
    const auto text = tools::describe(frame);
    CHECK(text.has_value());
    STRCMP_EQUAL("BodyState", text->name.c_str());
    STRCMP_EQUAL("Firmware", text->sender.c_str());
    STRCMP_EQUAL("forward_speed_m_per_s", text->fields[0].name.c_str());
    STRCMP_EQUAL("-0.1505", text->fields[0].value.c_str());
    STRCMP_EQUAL("m/s", text->fields[0].unit.c_str());
    STRCMP_EQUAL("0.700", text->fields[1].value.c_str());
}

TEST(MessageText, BadFramesSayWhy) {
    hal::CanFrame frame;
    frame.id = protocol::ModeCommand::id;
    frame.length = 3;
    protocol::ModeCommand message;
    message.mode = protocol::Mode::velocity;
    CHECK(protocol::encode_sealed(message, 3, std::span(frame.data)) == protocol::CodecStatus::ok);
    STRCMP_EQUAL("ModeCommand  mode velocity", tools::one_line(*tools::describe(frame)).c_str());
    frame.data[0] ^= 1U;
    STRCMP_EQUAL("wrong_crc", tools::describe(frame)->error.c_str());
    frame.length = 2;
    STRCMP_EQUAL("wrong_length", tools::describe(frame)->error.c_str());
    frame.id = 0x123;
    CHECK_FALSE(tools::describe(frame).has_value());
}
