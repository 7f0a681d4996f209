#include "tests/house/source_tree.h"

#include <algorithm>
#include <fstream>
#include <iterator>

namespace palpate::house {

namespace fs = std::filesystem;

fs::path source_root() {
  return PALPATE_SOURCE_ROOT;
}

std::vector<std::string> project_files() {
  std::vector<std::string> files;
  const fs::path root = source_root();
  for (auto it = fs::recursive_directory_iterator(root); it != fs::recursive_directory_iterator(); ++it) {
    const std::string name = it->path().filename().string();
    if (it->is_directory()) {
      const bool top = it.depth() == 0;
      const bool ours = name.front() != '.' || name == ".ci";
      if (!ours || (top && (name.starts_with("build") || name == "out" || name == "report")))
        it.disable_recursion_pending();
    } else if (it->is_regular_file()) {
      files.push_back(fs::relative(it->path(), root).generic_string());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::string text_of(const std::string& file) {
  std::ifstream in(source_root() / file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

std::vector<std::string> lines_of(const std::string& file) {
  std::ifstream in(source_root() / file);
  std::vector<std::string> lines;
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

bool is_source(const std::string& file) {
  return file.ends_with(".h") || file.ends_with(".cpp");
}
bool is_markdown(const std::string& file) {
  return file.ends_with(".md");
}

std::string findings_over(
    const std::function<bool(const std::string&)>& wanted,
    const std::function<std::string(const std::string&, const std::vector<std::string>&)>& check) {
  std::string found;
  for (const std::string& file : project_files())
    if (wanted(file)) found += check(file, lines_of(file));
  return found;
}

std::string findings_by_line(
    const std::function<bool(const std::string&)>& wanted,
    const std::function<std::string(const std::string&, const std::string&)>& check) {
  return findings_over(wanted, [&](const std::string& file, const std::vector<std::string>& lines) {
    std::string found;
    for (std::size_t i = 0; i < lines.size(); ++i)
      if (const std::string what = check(file, lines[i]); !what.empty())
        found += file + ":" + std::to_string(i + 1) + ": " + what + "\n";
    return found;
  });
}

}  // namespace palpate::house
