// sample_page FOLDER writes the sample page to FOLDER/index.html, for the browser's check.
#include <cstdio>
#include <exception>
#include <filesystem>

#include "tests/pages/sample.hpp"

int main(int argc, char** argv) {
    if (argc != 2) return 1;
    try {
        wheelwright::report::sample_page().write(std::filesystem::path(argv[1]) / "index.html");
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
    return 0;
}
