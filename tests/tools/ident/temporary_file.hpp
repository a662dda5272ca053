// A file that is gone when the test is over.
#pragma once

#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <string>

struct TemporaryFile {
    std::string path;

    TemporaryFile() {
        char name[] = "/tmp/wheelwright-ident-XXXXXX";
        const int descriptor = mkstemp(name);
        if (descriptor < 0) std::abort();
        close(descriptor);
        path = name;
    }
    explicit TemporaryFile(const std::string& text) : TemporaryFile() {
        std::FILE* file = std::fopen(path.c_str(), "w");
        if (file == nullptr || std::fwrite(text.data(), 1, text.size(), file) != text.size()) std::abort();
        std::fclose(file);
    }
    ~TemporaryFile() { std::remove(path.c_str()); }
    TemporaryFile(const TemporaryFile&) = delete;
    TemporaryFile& operator=(const TemporaryFile&) = delete;
};
