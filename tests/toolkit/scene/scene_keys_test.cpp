// The page about scene files names every key that is read, where it is read.
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <regex>
#include <sstream>

#include "toolkit/scene/scene.h"

namespace palpate::scene {
namespace {

/// The example of docs/scene.md.
std::string example() {
  std::ifstream page(PALPATE_SOURCE_ROOT "/docs/scene.md");
  std::stringstream all;
  all << page.rdbuf();
  const std::string text = all.str(), fence = "```toml\n";
  const std::size_t begin = text.find(fence);
  EXPECT_NE(begin, std::string::npos);
  return text.substr(begin + fence.size(), text.find("```", begin + fence.size()) - begin - fence.size());
}

/// What stands under each header, comments included; "" holds the headers.
std::map<std::string, std::string> sections(const std::string& text) {
  std::map<std::string, std::string> found;
  std::string table, line;
  std::istringstream lines(text);
  const std::regex header(R"(^\s*\[\[?([a-z.]+)\]\]?(.*))");
  for (std::smatch match; std::getline(lines, line); line.clear()) {
    if (std::regex_match(line, match, header)) {
      table = match[1];
      found[""] += table + "\n";
      line = match[2];
    }
    found[table] += line + "\n";
  }
  return found;
}

bool has_word(const std::string& text, const std::string& word) {
  return std::regex_search(text, std::regex("(^|[^a-z_.])" + word + "($|[^a-z_.])"));
}

TEST(SceneKeys, ThePageHasThemAll) {
  std::map<std::string, std::string> page = sections(example());
  std::size_t keys = 0;
  for (const TableKeys& table : scene_keys())
    for (const std::string& key : table.keys) {
      ++keys;
      const std::string own_table = table.table.empty() ? key : table.table + "." + key;
      EXPECT_TRUE(has_word(page[table.table], key) || has_word(page[""], own_table))
          << "docs/scene.md does not name '" << key << "' of [" << table.table << "]";
    }
  EXPECT_GT(keys, 50u) << "the tables of fields were not found";
}

TEST(SceneKeys, TheExampleOfThePageIsRead) {
  const Result<SceneFile> scene = parse_scene(example(), "docs/scene.md");
  ASSERT_TRUE(scene) << scene.error().message();
  EXPECT_EQ(scene->models.size(), 3u);
}

}  // namespace
}  // namespace palpate::scene
