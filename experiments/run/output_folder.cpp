#include "experiments/run/output_folder.h"

#include "toolkit/core/atomic_file.h"

namespace palpate::experiments {

namespace fs = std::filesystem;

Result<OutputFolder> OutputFolder::open(const std::string& folder) {
  const fs::path path(folder);
  std::error_code code;
  if (fs::exists(path, code) && !fs::is_directory(path, code))
    return Error{"is a file, and the results need a folder", "give --out another name", folder, 0};
  fs::create_directories(path, code);
  if (code)
    return Error{"the folder cannot be made: " + code.message(), "give --out a place you may write", folder,
                 0};
  if (!fs::is_empty(path, code) && !fs::exists(path / kFolderMark, code))
    return Error{"the folder holds files that are not results of Palpate",
                 "give --out a new or an empty folder", folder, 0};
  OutputFolder made(path);
  if (const Status marked =
          made.write(kFolderMark, "Results of Palpate: replaced by the next run with this folder.\n");
      !marked)
    return Error{"the folder cannot be written", "give --out a place you may write", folder, 0};
  for (const char* name : {"result.json", "report.html"}) fs::remove(path / name, code);
  return made;
}

Result<OutputFolder> OutputFolder::inside(const std::string& name) const {
  std::error_code code;
  fs::create_directories(folder_ / name, code);
  if (code) return Error{"the folder cannot be made: " + code.message(), {}, (folder_ / name).string(), 0};
  return OutputFolder(folder_ / name);
}

Status OutputFolder::write(const std::string& name, std::string_view text) const {
  return palpate::write_file(file(name).string(), text);
}

}  // namespace palpate::experiments
