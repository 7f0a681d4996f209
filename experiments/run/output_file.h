// Files that the user names to be written: whether they may be.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <palpate/result.h>

namespace palpate::experiments {

/// A file that a command is asked to write.
struct OutputFile {
  std::string path;
  std::vector<std::string> endings;  ///< of the formats that can be written, without the dot
  bool force = false;                ///< replaces also what is somebody else's, or read
};

/// Errors: the ending stands for no format that is written; the folder is missing; `path` is no plain file
/// (whatever `force` says); it is one of the files `read` by the command, under whatever name; it is there
/// and Palpate did not write it. What Palpate wrote is replaced.
[[nodiscard]] Status check_output(const OutputFile& file, std::span<const std::string> read);

}  // namespace palpate::experiments
