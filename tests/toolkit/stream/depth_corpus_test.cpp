// Replays what the fuzzer of streams found or began with; the fuzzer's own checks end the program.
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

#include "tests/toolkit/messages.h"
#include "toolkit/core/files.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace palpate::stream {
namespace {

TEST(DepthCorpus, IsReadOrRefused) {
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(PALPATE_CORPUS)) {
    const std::string bytes = test::value_of(read_file(entry.path().string(), std::uint64_t{1} << 20));
    const auto feed = [](const std::string& text) {
      LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
    };
    feed(bytes);
    test::each_cut(bytes, bytes.size(), feed);
    test::each_flip(bytes, {0x11}, feed);
    ++files;
  }
  EXPECT_GE(files, 8u) << "one of each kind";
}

}  // namespace
}  // namespace palpate::stream
