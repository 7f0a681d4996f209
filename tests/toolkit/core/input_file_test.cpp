// Files as they are opened: regular ones alone, and never a wait for the others.
#include "toolkit/core/input_file.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <fstream>

#include "tests/in_folder.h"

namespace palpate {
namespace {

class InputFiles : public InFolder {
 protected:
  [[nodiscard]] std::string holding(const std::string& name, const std::string& text) const {
    std::ofstream(in(name), std::ios::binary) << text;
    return in(name);
  }
  static std::string refusal(const std::string& path) {
    const Result<InputFile> file = InputFile::open(path);
    EXPECT_FALSE(file.ok()) << path;
    if (file) return {};
    EXPECT_EQ(file.error().file, path);
    EXPECT_EQ(file.error().line, 0);
    EXPECT_FALSE(file.error().remedy.empty());
    return file.error().what;
  }
};

TEST_F(InputFiles, ARegularFileIsReadWhole) {
  const std::string path = holding("a.txt", "one two");
  Result<InputFile> file = InputFile::open(path);
  ASSERT_TRUE(file.ok());
  EXPECT_EQ(file->size(), 7u);
  std::string text(5, ' ');
  EXPECT_EQ(*file->read(std::as_writable_bytes(std::span(text))), 5u);
  EXPECT_EQ(text, "one t");
  InputFile moved = *std::move(file);
  EXPECT_EQ(*moved.read(std::as_writable_bytes(std::span(text))), 2u);
  EXPECT_EQ(text.substr(0, 2), "wo");
  EXPECT_EQ(*moved.read(std::as_writable_bytes(std::span(text))), 0u);
  EXPECT_EQ(*read_file(path, 7), "one two");
  EXPECT_FALSE(read_file(path, 6).ok());
  EXPECT_EQ(*read_file(holding("empty", ""), 0), "");
}

TEST_F(InputFiles, WhatIsNoRegularFileIsNamed) {
  EXPECT_NE(refusal(folder_.string()).find("folder"), std::string::npos);
  EXPECT_EQ(refusal(in("none")), "no such file");
  std::filesystem::create_symlink(in("none"), in("dangling"));
  EXPECT_EQ(refusal(in("dangling")), "no such file");
  EXPECT_EQ(refusal(holding("file", "x") + "/below"), "no such file");
  // A pipe without a writer: opened as a file is, it would wait for ever.
  ASSERT_EQ(::mkfifo(in("pipe").c_str(), 0600), 0);
  EXPECT_NE(refusal(in("pipe")).find("a pipe"), std::string::npos);
  for (const char* device : {"/dev/zero", "/dev/null"}) {
    std::filesystem::remove(in("device"));
    std::filesystem::create_symlink(device, in("device"));
    EXPECT_NE(refusal(in("device")).find("a device"), std::string::npos);
  }
  const int fd = ::socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::filesystem::current_path(folder_);  // the path of a socket has little room
  address.sun_path[0] = 's';
  ASSERT_EQ(::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  EXPECT_NE(refusal(in("s")).find("a socket"), std::string::npos);
  ::close(fd);
  std::filesystem::current_path("/");
}

TEST_F(InputFiles, SizesThatAreNotTrue) {
  // A hole of a terabyte takes nothing on the disk, and is refused before it takes memory.
  const std::string hole = holding("hole", "");
  if (::truncate(hole.c_str(), off_t{1} << 40) == 0) {
    EXPECT_FALSE(read_file(hole, 1u << 20).ok());
  }
  // Files of the system say 0 and hold more.
  const Result<std::string> status = read_file("/proc/self/status", 1u << 20);
  ASSERT_TRUE(status.ok());
  EXPECT_NE(status->find("Name:"), std::string::npos);
  EXPECT_FALSE(read_file("/proc/self/status", 10).ok());
}

TEST(ByteOrderMark, OfUtf8IsPassedOverAndOthersAreNamed) {
  EXPECT_EQ(*byte_order_mark(""), 0u);
  EXPECT_EQ(*byte_order_mark("t_s"), 0u);
  EXPECT_EQ(*byte_order_mark("\xEF\xBB\xBFt_s"), 3u);
  const std::string nul(2, '\0');
  for (const std::string& mark : {std::string("\xFF\xFEt"), std::string("\xFE\xFF")})
    EXPECT_EQ(byte_order_mark(mark).error().what, "the text is UTF-16");
  for (const std::string& mark : {"\xFF\xFE" + nul, nul + "\xFE\xFF"})
    EXPECT_EQ(byte_order_mark(mark).error().what, "the text is UTF-32");
  EXPECT_EQ(byte_order_mark("\xFF\xFEt").error().line, 1);
}

}  // namespace
}  // namespace palpate
