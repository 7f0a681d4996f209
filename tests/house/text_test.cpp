// Checks lengths, links and machine paths in the whole tree; each check can fail.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <regex>
#include <sstream>
#include <string_view>

#include "tests/house/source_tree.h"

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

/// Longer files are split, or say why not near their head ("Over 500 lines: ...").
constexpr std::size_t kMaxLines = 500;
constexpr std::size_t kHeadLines = 10;  ///< the reason must be in these lines

/// True if a source file is short enough or gives its reason.
bool length_is_fine(const std::vector<std::string>& lines) {
  if (lines.size() <= kMaxLines) return true;
  const std::size_t head = std::min(lines.size(), kHeadLines);
  return std::any_of(
      lines.begin(), lines.begin() + static_cast<std::ptrdiff_t>(head),
      [](const std::string& line) { return line.find("Over 500 lines:") != std::string::npos; });
}

/// A shorter header of the libraries joins the one it belongs to, or has its reason below.
constexpr std::size_t kMinHeaderLines = 50;

/// Headers under kMinHeaderLines that stay, each with the reason.
const std::map<std::string, std::string> kShort = {
    {"baselines/cleaning/steps.h", "joins two files of steps: CGAL's on points, and those on surfaces"},
    {"baselines/include/palpate/baselines.h", "all that an application includes of this component"},
    {"baselines/option_specs.h", "words of options for three rooms, which share nothing else"},
    {"baselines/reference/closest_mesh.h", "a second truth, which shares no code with mesh_reference.h"},
    {"device/drivers/all_drivers.h", "the only entry of its room"},
    {"toolkit/core/instruction_counter.h", "marks for callgrind, needed by benchmarks alone"},
    {"toolkit/core/option_specs.h",
     "words of options for every renderer; options.h is installed, they are not"},
    {"toolkit/core/random.h", "random numbers alone, as most of those who draw need nothing more"},
    {"toolkit/core/simd.h", "vector types and the choice of kernels, for all who have either"},
    {"toolkit/dem/dem_check.h", "checks of hostile heads, free of GDAL and tested without it"},
    {"toolkit/depth_surface/depth_image_receiver.h", "runs on another thread than the contact beside it"},
    {"toolkit/include/palpate/vec.h", "the vector type, included by every public header with places"},
    {"toolkit/io/pcd_header.h", "a format that two targets read, with PCL and without"},
    {"toolkit/io/point_stream.h", "the interface that every reader of streams implements"},
    {"toolkit/renderers/renderer_infos.h", "the list of the toolkit's renderers"},
    {"toolkit/scene/model_keys.h", "the keys of a model; toml_fields.h reads any table"},
    {"toolkit/voronoi/voronoi.h", "the only header of a target of its own"},
};

/// True for a header of the libraries.
bool is_library_header(const std::string& file) {
  return file.ends_with(".h") &&
         (file.starts_with("toolkit/") || file.starts_with("baselines/") || file.starts_with("device/"));
}

/// Why a header of so many lines must go or leave the table; empty if neither.
std::string short_header(const std::map<std::string, std::string>& reasons, const std::string& file,
                         std::size_t lines) {
  const bool has_reason = reasons.count(file) != 0;
  if (lines < kMinHeaderLines && !has_reason)
    return file + ": " + std::to_string(lines) + " lines and no reason\n";
  if (lines >= kMinHeaderLines && has_reason) return file + ": long enough, so it needs no reason\n";
  return {};
}

/// Link and image targets of a Markdown text within the project: no web or mail addresses.
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

/// Anchors of a Markdown text's headings ("## The frame path" -> "the-frame-path").
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

/// Why link `target` in `file` is broken; empty if valid. `read` gives a file's text.
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

/// True if a line opens a file for reading without toolkit/core/files.h, which alone refuses pipes and
/// devices. System files are exempt.
bool opens_a_file(const std::string& line) {
  static const std::regex kOpens(R"((std::i?fstream\b|\bfopen\(|::open\(.*O_RDONLY))");
  // Regular expressions are slow, and most lines name neither.
  if (line.find("open") == std::string::npos && line.find("stream") == std::string::npos) return false;
  const std::string code = line.substr(0, line.find("//"));
  // "wb" writes.
  return std::regex_search(code, kOpens) && code.find("\"/proc/") == std::string::npos &&
         code.find("\"/sys/") == std::string::npos && code.find("\"wb\"") == std::string::npos;
}

/// True if a line names a machine path or a package registry's host.
bool names_a_machine(const std::string& line) {
  if (line.find_first_of("/.") == std::string::npos) return false;
  // In pieces, so that this file does not contain what it forbids.
  static const std::string kFolders =
      std::string("wo") + "rk|far" + "m|ho" + "me|Use" + "rs|ro" + "ot|sha" + "red|tm" + "p/w";
  static const std::regex kPath("(^|[^A-Za-z0-9_.$})/-])/(" + kFolders + ")/[A-Za-z]");
  static const std::regex kHost(std::string("regis") + R"(try\.[a-z]+\.(org|com)|deb\.deb)" +
                                R"(ian\.org|pypi\.)" + "org");
  return std::regex_search(line, kPath) || std::regex_search(line, kHost);
}

// ---- the tree

TEST(FileLength, EverySourceIsShortOrSaysWhyNot) {
  EXPECT_EQ(findings_over(is_source,
                          [](const std::string& file, const auto& lines) {
                            return length_is_fine(lines)
                                       ? std::string()
                                       : file + ": " + std::to_string(lines.size()) + " lines\n";
                          }),
            "");
}

TEST(FileLength, LongOnesAreFound) {
  std::vector<std::string> lines(kMaxLines, "int x;");
  EXPECT_TRUE(length_is_fine(lines));
  lines.push_back("int y;");
  EXPECT_FALSE(length_is_fine(lines));
  lines[2] = "// Over 500 lines: one table that must not be torn apart.";
  EXPECT_TRUE(length_is_fine(lines));
  std::swap(lines[2], lines[100]);
  EXPECT_FALSE(length_is_fine(lines)) << "a reason belongs at the head";
}

TEST(FileLength, EveryHeaderOfTheLibrariesIsLongEnoughOrHasAReason) {
  std::size_t reasons_used = 0;
  EXPECT_EQ(findings_over(is_library_header,
                          [&](const std::string& file, const auto& lines) {
                            reasons_used += kShort.count(file);
                            return short_header(kShort, file, lines.size());
                          }),
            "");
  EXPECT_EQ(reasons_used, kShort.size()) << "a header of the table is gone";
  for (const auto& [file, reason] : kShort) EXPECT_NE(reason, "") << file;
}

TEST(FileLength, ShortHeadersAndStaleReasonsAreFound) {
  const std::map<std::string, std::string> reasons = {{"toolkit/core/a.h", "a reason"}};
  EXPECT_EQ(short_header(reasons, "toolkit/core/a.h", kMinHeaderLines - 1), "");
  EXPECT_NE(short_header(reasons, "toolkit/core/b.h", kMinHeaderLines - 1), "");
  EXPECT_EQ(short_header(reasons, "toolkit/core/b.h", kMinHeaderLines), "");
  EXPECT_NE(short_header(reasons, "toolkit/core/a.h", kMinHeaderLines), "");
  EXPECT_TRUE(is_library_header("device/include/palpate/device/servo.h"));
  EXPECT_FALSE(is_library_header("device/servo/servo.cpp"));
  EXPECT_FALSE(is_library_header("experiments/run/run.h"));
}

TEST(Links, EveryInternalLinkLeadsSomewhere) {
  std::size_t links = 0;
  const auto exists = [](const std::string& path) { return std::filesystem::exists(source_root() / path); };
  const std::string found = findings_over(is_markdown, [&](const std::string& file, const auto&) {
    std::string bad;
    for (const std::string& target : internal_links(text_of(file))) {
      ++links;
      bad += broken_link(file, target, exists, text_of);
    }
    return bad;
  });
  EXPECT_EQ(found, "");
  EXPECT_GT(links, 5u) << "too few links: are README.md and docs there?";
}

TEST(Links, AreReadAndFollowed) {
  const std::string text =
      "# A title, with: marks\n[a](docs/a.md) ![p](p.png \"t\") [w](https://x.org/y) "
      "[h](#a-title-with-marks)\n"
      "```\n[code](not/a/link.md)\n```\n";
  const std::vector<std::string> expected = {"docs/a.md", "p.png", "#a-title-with-marks"};
  EXPECT_EQ(internal_links(text), expected);
  const auto exists = [](const std::string& path) { return path == "README.md" || path == "docs/a.md"; };
  const auto read = [&](const std::string&) { return text; };
  EXPECT_EQ(broken_link("README.md", "docs/a.md", exists, read), "");
  EXPECT_EQ(broken_link("docs/a.md", "../README.md#a-title-with-marks", exists, read), "");
  EXPECT_NE(broken_link("README.md", "docs/b.md", exists, read), "");
  EXPECT_NE(broken_link("docs/a.md", "docs/a.md", exists, read), "") << "links are relative to their file";
  EXPECT_NE(broken_link("README.md", "docs/a.md#no-such-heading", exists, read), "");
}

TEST(MachinePaths, NoneInTheTree) {
  const auto text = [](const std::string& file) {
    static const std::vector<std::string> kKinds = {".h",  ".cpp",  ".md",   ".txt", ".cmake",
                                                    ".in", ".json", ".cff",  ".sh",  ".toml",
                                                    ".gp", ".csv",  ".html", ".yml"};
    const std::string name = std::filesystem::path(file).filename().string();
    return name.find('.') == std::string::npos ||
           std::any_of(kKinds.begin(), kKinds.end(),
                       [&](const std::string& kind) { return file.ends_with(kind); });
  };
  EXPECT_EQ(findings_by_line(text,
                             [](const std::string&, const std::string& line) {
                               return names_a_machine(line) ? line : std::string();
                             }),
            "");
}

TEST(MachinePaths, AreFound) {
  // In pieces, so that the test above does not find this file.
  EXPECT_TRUE(names_a_machine(std::string("open(\"/ho") + "me/someone/scan.ply\")"));
  EXPECT_TRUE(names_a_machine(std::string("/wo") + "rk/data"));
  EXPECT_TRUE(names_a_machine(std::string("https://regis") + "try.example.org/x"));
  EXPECT_FALSE(names_a_machine("docs/work/in/progress.md"));
  EXPECT_FALSE(names_a_machine("$PALPATE_DATA/stanford/dragon_vrip.ply.gz"));
  EXPECT_FALSE(names_a_machine("/usr/local/share/palpate"));
}

TEST(Files, AreOpenedInOneWay) {
  const auto ours = [](const std::string& file) {
    return is_source(file) && !file.starts_with("tests/") && file != "toolkit/core/files.cpp";
  };
  EXPECT_EQ(findings_by_line(ours,
                             [](const std::string&, const std::string& line) {
                               return opens_a_file(line) ? line : std::string();
                             }),
            "");
}

TEST(Files, OtherWaysAreFound) {
  EXPECT_TRUE(opens_a_file("  std::ifstream file(path, std::ios::binary);"));
  EXPECT_TRUE(opens_a_file("  std::fstream file(path);"));
  EXPECT_TRUE(opens_a_file("  std::FILE* file = std::fopen(path.c_str(), \"rb\");"));
  EXPECT_TRUE(opens_a_file("  const int fd = ::open(path.c_str(), O_RDONLY);"));
  EXPECT_FALSE(opens_a_file("  std::FILE* file = std::fopen(path.c_str(), \"wb\");"));
  EXPECT_FALSE(opens_a_file("  std::ifstream file(\"/proc/cpuinfo\");"));
  EXPECT_FALSE(opens_a_file("  // not by std::ifstream"));
}

}  // namespace
}  // namespace palpate::house
