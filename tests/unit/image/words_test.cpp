// SPDX-License-Identifier: Apache-2.0
// Pictures of words are read back bit for bit, or not at all.
#include "core/image/words.h"

#include "core/math/hash.h"
#include "core/math/problem.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <vector>

#include <unistd.h>

namespace marram {
namespace {

class Words : public ::testing::Test {
  protected:
    ~Words() override { std::filesystem::remove(path); }

    // Random bits, also those that would be a NaN.
    static std::vector<uint32_t> values_of(const WordsHeader& header) {
        std::vector<uint32_t> values(size_t(header.width) * size_t(header.height) * size_t(header.channels));
        for (size_t i = 0; i < values.size(); ++i) values[i] = uint32_t(hash(7, i));
        return values;
    }
    void write(const WordsHeader& header, const std::vector<uint32_t>& values) const {
        const size_t stride = size_t(header.width) * size_t(header.channels);
        write_words(path, header, [&](int y, uint32_t* row) {
            std::copy_n(values.data() + stride * size_t(y), stride, row);
        });
    }
    std::vector<uint32_t> read(const WordsHeader& header) const {
        const size_t stride = size_t(header.width) * size_t(header.channels);
        std::vector<uint32_t> values(stride * size_t(header.height));
        read_words(path, header, [&](int y, const uint32_t* row) {
            std::copy_n(row, stride, values.data() + stride * size_t(y));
        });
        return values;
    }

    std::string path =
        (std::filesystem::temp_directory_path() / ("marram_words_" + std::to_string(::getpid()) + ".tif"))
            .string();
};

// Of four channels the last could be taken for alpha, and the others multiplied by it.
TEST_F(Words, ComeBackBitForBit) {
    for (const int channels : {1, 2, 3, 4, 5, 11, 60}) {
        const WordsHeader header{37, 150, channels, "what it is"};
        const std::vector<uint32_t> values = values_of(header);
        write(header, values);
        const WordsHeader found = read_words_header(path);
        EXPECT_EQ(found.width, 37);
        EXPECT_EQ(found.height, 150);
        EXPECT_EQ(found.channels, channels);
        EXPECT_EQ(found.description, "what it is");
        EXPECT_EQ(std::memcmp(read(header).data(), values.data(), values.size() * sizeof(uint32_t)), 0)
            << channels;
    }
}

TEST_F(Words, AreRefusedWhereTheyAreNotWhole) {
    const WordsHeader header{40, 30, 5, "x"};
    write(header, values_of(header));
    EXPECT_THROW(read({40, 30, 4, "x"}), InputError);
    EXPECT_THROW(read({40, 30, 5, "y"}), InputError);
    const auto size = std::filesystem::file_size(path);
    for (const auto left : {size - 400, size / 2, size_t(100), size_t(0)}) {
        std::filesystem::resize_file(path, left);
        EXPECT_THROW(read(header), InputError) << left;
    }
    std::filesystem::remove(path);
    EXPECT_THROW(read_words_header(path), InputError);
}

} // namespace
} // namespace marram
