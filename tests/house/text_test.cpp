// Checks lengths, links and machine paths in the whole tree; each check can fail.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/house/source_tree.h"
#include "tests/house/text_rules.h"

namespace palpate::house {
namespace {

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
  EXPECT_EQ(findings_over(text,
                          [](const std::string& file, const auto& lines) {
                            std::string bad;
                            for (std::size_t i = 0; i < lines.size(); ++i)
                              if (names_a_machine(lines[i])) bad += file + ":" + std::to_string(i + 1) + "\n";
                            return bad;
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
    return is_source(file) && !file.starts_with("tests/") && file != "toolkit/core/input_file.cpp";
  };
  EXPECT_EQ(findings_over(ours,
                          [](const std::string& file, const auto& lines) {
                            std::string bad;
                            for (std::size_t i = 0; i < lines.size(); ++i)
                              if (opens_a_file(lines[i])) bad += file + ":" + std::to_string(i + 1) + "\n";
                            return bad;
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
