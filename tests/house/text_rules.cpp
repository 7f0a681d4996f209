#include "tests/house/text_rules.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <regex>
#include <sstream>

namespace palpate::house {
namespace {

// Lines outside fenced code blocks.
std::vector<std::string> prose_lines(std::string_view markdown) {
  std::vector<std::string> lines;
  std::istringstream in{std::string(markdown)};
  bool code = false;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("```"))
      code = !code;
    else if (!code)
      lines.push_back(line);
  }
  return lines;
}

}  // namespace

bool length_is_fine(const std::vector<std::string>& lines) {
  if (lines.size() <= kMaxLines) return true;
  const std::size_t head = std::min(lines.size(), kHeadLines);
  return std::any_of(
      lines.begin(), lines.begin() + static_cast<std::ptrdiff_t>(head),
      [](const std::string& line) { return line.find("Over 500 lines:") != std::string::npos; });
}

std::vector<std::string> internal_links(std::string_view markdown) {
  static const std::regex kLink(R"(\]\(([^)\s]+)(\s+"[^"]*")?\))");
  static const std::regex kScheme(R"(^[a-z][a-z0-9+.-]*:)");
  std::vector<std::string> links;
  for (const std::string& line : prose_lines(markdown))
    for (std::sregex_iterator it(line.begin(), line.end(), kLink), end; it != end; ++it) {
      const std::string target = (*it)[1].str();
      if (!std::regex_search(target, kScheme)) links.push_back(target);
    }
  return links;
}

std::vector<std::string> anchors(std::string_view markdown) {
  std::vector<std::string> found;
  for (const std::string& line : prose_lines(markdown)) {
    const std::size_t text = line.find_first_not_of('#');
    if (text == 0 || text == std::string::npos || line[text] != ' ') continue;
    std::string anchor;
    for (const char c : line.substr(text + 1)) {
      const auto u = static_cast<unsigned char>(c);
      if (std::isalnum(u) != 0 || c == '_' || c == '-') anchor += static_cast<char>(std::tolower(u));
      if (c == ' ') anchor += '-';
    }
    found.push_back(anchor);
  }
  return found;
}

std::string broken_link(const std::string& file, const std::string& target,
                        const std::function<bool(const std::string&)>& exists,
                        const std::function<std::string(const std::string&)>& read) {
  const std::size_t hash = target.find('#');
  const std::string name = target.substr(0, hash);
  const std::filesystem::path folder = std::filesystem::path(file).parent_path();
  const std::string path = name.empty() ? file : (folder / name).lexically_normal().generic_string();
  if (!exists(path)) return file + ": " + target + " does not exist\n";
  if (hash == std::string::npos || !path.ends_with(".md")) return {};
  const std::vector<std::string> known = anchors(read(path));
  if (std::find(known.begin(), known.end(), target.substr(hash + 1)) == known.end())
    return file + ": " + target + " names no heading\n";
  return {};
}

bool opens_a_file(const std::string& line) {
  static const std::regex kOpens(R"((std::i?fstream\b|\bfopen\(|::open\(.*O_RDONLY))");
  const std::string code = line.substr(0, line.find("//"));
  // "wb" writes.
  return std::regex_search(code, kOpens) && code.find("\"/proc/") == std::string::npos &&
         code.find("\"/sys/") == std::string::npos && code.find("\"wb\"") == std::string::npos;
}

bool names_a_machine(const std::string& line) {
  // In pieces, so that this file does not contain what it forbids.
  static const std::string kFolders =
      std::string("wo") + "rk|far" + "m|ho" + "me|Use" + "rs|ro" + "ot|sha" + "red|tm" + "p/w";
  static const std::regex kPath("(^|[^A-Za-z0-9_.$})/-])/(" + kFolders + ")/[A-Za-z]");
  static const std::regex kHost(std::string("regis") + R"(try\.[a-z]+\.(org|com)|deb\.deb)" +
                                R"(ian\.org|pypi\.)" + "org");
  return std::regex_search(line, kPath) || std::regex_search(line, kHost);
}

}  // namespace palpate::house
