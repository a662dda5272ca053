// The key file: what is read, what is refused and why, and that no message holds the key.
#include "firmware/task/key_file.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <string>

//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

constexpr const char* kHex = "00112233445566778899aAbBcCdDeEfF";

}  // namespace

TEST_GROUP(KeyFile) {
    std::string folder, path;
    void setup() override {
        char name[] = "/tmp/wheelwright_key_XXXXXX";
        folder = ::mkdtemp(name);
        path = folder + "/robot.key";
    }
    void teardown() override {
        ::unlink(path.c_str());
        ::rmdir(folder.c_str());
        folder = path = std::string();
        folder.shrink_to_fit();
        path.shrink_to_fit();
    }
    void write(const std::string& text, mode_t mode = 0600) const {
        std::FILE* file = std::fopen(path.c_str(), "w");
        std::fputs(text.c_str(), file);
        std::fclose(file);
        ::chmod(path.c_str(), mode);
    }
    std::string complaint() const {
        task::KeyFile key;
        return task::read_key_file(path, key);
    }
    void refused(const std::string& text, const char* because) const {
        write(text);
        const std::string said = complaint();
        CHECK_TEXT(said.starts_with(path + ": ") && said.find(because) != std::string::npos, said.c_str());
        CHECK_TEXT(said.find("11223344") == std::string::npos, said.c_str());
    }
};

TEST(KeyFile, what_is_written_is_read_and_is_for_its_owner_alone) {
    task::KeyFile made;
    made.robot = "cart 7";
    for (std::size_t i = 0; i < 16; ++i) made.key[i] = static_cast<std::uint8_t>(17 * i);
    CHECK(task::write_key_file(path, made) == "");
    struct stat about {};
    CHECK(::stat(path.c_str(), &about) == 0);
    LONGS_EQUAL(0600, about.st_mode & 07777U);
    task::KeyFile read;
    CHECK(task::read_key_file(path, read) == "");
    CHECK(read.robot == "cart 7" && read.key == made.key);
    CHECK(task::write_key_file(path, made).find("File exists") != std::string::npos);
}

TEST(KeyFile, comments_order_and_case_are_free) {
    write(std::string("# a note\n\nkey ") + kHex + "\nrobot x");
    task::KeyFile read;
    CHECK(task::read_key_file(path, read) == "");
    LONGS_EQUAL(0xFF, read.key[15]);
    CHECK(read.robot == "x");
}

TEST(KeyFile, is_refused_where_others_may_read_or_write_it) {
    const std::string good = std::string("robot x\nkey ") + kHex + "\n";
    for (const mode_t mode : {0640U, 0604U, 0620U, 0601U, 0666U}) {
        write(good, mode);
        const std::string said = complaint();
        CHECK_TEXT(said.find("expected 0600 (chmod 600)") != std::string::npos, said.c_str());
        CHECK(said.starts_with(path + ": "));
    }
    write(good, 0400);
    CHECK(complaint() == "");
    if (::geteuid() == 0) {
        CHECK(::chown(path.c_str(), 65534, 65534) == 0);
        CHECK(complaint().find("belongs to user 65534") != std::string::npos);
    }
}

TEST(KeyFile, says_where_it_is_wrong_and_never_what_stands_there) {
    const std::string key = std::string("key ") + kHex + "\n";
    refused(key, "expected a line `robot NAME`");
    refused("robot x\n", "expected a line `key HEX`");
    refused("robot x\n" + key + key, "line 3");
    refused("robot x\nrobot y\n" + key, "line 2");
    refused(key + "robot \n", "line 2: expected a name");
    refused("robot " + std::string(33, 'x') + "\n" + key, "line 1: expected a name of 1 to 32 bytes");
    refused("robot x\nkey 11223344\n", "line 2: expected 32 hexadecimal digits");
    refused(std::string("robot x\nkey ") + kHex + "0\n", "line 2");
    refused("robot x\nkey 112233445566778899aabbccddeeff+1\n", "line 2");
    refused("robot x\nkey  1223344556677889900aabbccddeeff\n", "line 2");
    refused("11223344 = x\n", "line 1");
    refused(std::string(2000, '#'), "longer");
    CHECK(task::robot_name_error("a\tb") != "");
    ::unlink(path.c_str());
    CHECK(complaint().find("cannot open") != std::string::npos);
    CHECK(::mkfifo(path.c_str(), 0600) == 0);  // nobody writes into it
    CHECK(complaint().find("expected a file") != std::string::npos);
}
