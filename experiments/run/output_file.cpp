#include "experiments/run/output_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include <palpate/write_mesh.h>
#include "toolkit/io/text.h"

namespace palpate::experiments {

namespace fs = std::filesystem;

Status check_output(const OutputFile& file, std::span<const std::string> read) {
  const auto wrong = [&](std::string what, std::string remedy) {
    return Error{std::move(what), std::move(remedy), file.path, 0};
  };
  const fs::path path = file.path;
  std::string ending = io::lower_case(path.extension().string());
  if (!ending.empty()) ending.erase(0, 1);
  if (std::find(file.endings.begin(), file.endings.end(), ending) == file.endings.end()) {
    std::string known;
    for (const std::string& e : file.endings) known += (known.empty() ? "." : ", .") + e;
    return wrong(ending.empty() ? std::string("the name has no ending that says the format")
                                : fmt::format("no file ending in .{} can be written here", ending),
                 fmt::format("give it one of {}", known));
  }
  std::error_code code;
  const fs::path folder = path.parent_path();
  if (!folder.empty() && !fs::is_directory(folder, code))
    return wrong("the folder for it is not there", "create the folder first");
  if (!fs::exists(path, code)) return Done{};
  if (!fs::is_regular_file(path, code)) return wrong("is not a plain file", "give another name");
  if (file.force) return Done{};
  for (const std::string& input : read)
    if (fs::equivalent(path, input, code))
      return wrong("is read by this command, and would be overwritten", "give another name, or --force");
  if (!io::is_written_by_palpate(file.path))
    return wrong("is there already, and Palpate did not write it",
                 "give another name, or --force to replace it");
  return Done{};
}

}  // namespace palpate::experiments
