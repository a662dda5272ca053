// A folder that goes with this, for what nobody wants to keep.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>

namespace wheelwright::tools {

class ScratchFolder {
  public:
    // Throws std::runtime_error when it cannot be made.
    ScratchFolder() {
        path_ = (std::filesystem::temp_directory_path() / "wheelwright-XXXXXX").string();
        if (::mkdtemp(path_.data()) == nullptr) throw std::runtime_error("cannot make " + path_);
    }
    ~ScratchFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    ScratchFolder(const ScratchFolder&) = delete;
    ScratchFolder& operator=(const ScratchFolder&) = delete;
    const std::string& path() const { return path_; }

  private:
    std::string path_;
};

}  // namespace wheelwright::tools
