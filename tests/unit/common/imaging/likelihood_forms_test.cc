// Likelihoods and labels in the forms of other programs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "common/imaging/image_io.h"
#include "common/imaging/label_file.h"
#include "common/imaging/likelihood_form.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

using Colors = std::vector<std::array<uint8_t, 3>>;
const Colors kColors = {{128, 128, 128}, {128, 0, 128}, {230, 190, 30}};

LensModel SmallCamera() {
  LensModel lens;
  lens.pinhole = {4, 3, 10, 10, 2, 1.5};
  return lens;
}

std::string NpyText(const std::string& descr, const std::string& shape, bool fortran, const std::string& values) {
  const std::string header = absl::StrCat("{'descr': '", descr, "', 'fortran_order': ", fortran ? "True" : "False",
                                          ", 'shape': (", shape, "), }\n");
  return absl::StrCat(std::string("\x93NUMPY\x01\x00", 8), std::string(1, static_cast<char>(header.size())),
                      std::string(1, '\0'), header, values);
}

template <class Value>
std::string Stored(const std::vector<Value>& values, bool big_endian = false) {
  std::string bytes;
  for (const Value& value : values) {
    std::string one(reinterpret_cast<const char*>(&value), sizeof value);
    if (big_endian) std::reverse(one.begin(), one.end());
    bytes += one;
  }
  return bytes;
}

// Two classes on 4 x 3 pixels; the first has the value (x + 4 y + 1) / 16.
double ValueAt(int c, int y, int x) { return c == 0 ? (x + 4 * y + 1) / 16.0 : 1 - (x + 4 * y + 1) / 16.0; }

// The values of ValueAt with the axes in this order, the last the fastest.
template <class Value>
std::vector<Value> InOrder(const std::string& axes) {
  std::vector<Value> values;
  const auto size = [](char axis) { return axis == 'c' ? 2 : axis == 'y' ? 3 : 4; };
  for (int i = 0; i < size(axes[0]); ++i) {
    for (int j = 0; j < size(axes[1]); ++j) {
      for (int k = 0; k < size(axes[2]); ++k) {
        const auto of = [&](char axis) { return axes[0] == axis ? i : axes[1] == axis ? j : k; };
        values.push_back(static_cast<Value>(ValueAt(of('c'), of('y'), of('x'))));
      }
    }
  }
  return values;
}

class LikelihoodFormsTest : public testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& content) {
    WriteText(folder_ + "/" + name, content);
    return folder_ + "/" + name;
  }
  // A PNG of 4 x 3 pixels with one row of bytes for each of its rows, made of an encoded grey one.
  std::string WritePalette(const std::string& name, const std::vector<uint8_t>& indices, const Colors& palette) {
    ByteImage image(4, 3);
    image.data = indices;
    const std::string path = folder_ + "/" + name;
    EXPECT_TRUE(WritePng(path, image).ok());
    std::string bytes = ReadText(path);
    std::string entries;
    for (const auto& color : palette) entries.append(reinterpret_cast<const char*>(color.data()), 3);
    std::string header = bytes.substr(12, 17);
    header[13] = 3;
    return Write(name, bytes.substr(0, 8) + Chunk(header) + Chunk("PLTE" + entries) + bytes.substr(33));
  }
  // Adds the length and the checksum to a chunk's type and data.
  static std::string Chunk(const std::string& content) {
    uint32_t crc = 0xffffffff;
    for (const char c : content) {
      crc ^= static_cast<uint8_t>(c);
      for (int bit = 0; bit < 8; ++bit) crc = crc & 1 ? 0xedb88320 ^ crc >> 1 : crc >> 1;
    }
    return Stored<uint32_t>({static_cast<uint32_t>(content.size() - 4)}, true) + content +
           Stored<uint32_t>({~crc}, true);
  }
  std::string WriteColors(const std::string& name, const Colors& pixels) {
    ByteImage image(4, 3, 3);
    for (size_t i = 0; i < 12; ++i) {
      for (int c = 0; c < 3; ++c) image.plane(c)[i] = pixels[i][c];
    }
    const std::string path = folder_ + "/" + name;
    EXPECT_TRUE(WritePng(path, image).ok());
    return path;
  }
  static std::string ErrorOf(const std::string& path, int classes, const LikelihoodForm& form = {}) {
    return std::string(ReadLikelihoods(path, classes, SmallCamera(), form).status().message());
  }
  // The likeliest classes, 9 where they are equal.
  static std::vector<int> LabelsOf(const std::string& path, const LikelihoodForm& form = {}) {
    const StatusOr<FloatImage> image = ReadLikelihoods(path, 3, SmallCamera(), form);
    EXPECT_TRUE(image.ok()) << image.status();
    std::vector<int> labels;
    for (size_t i = 0; image.ok() && i < image->plane_size(); ++i) {
      int label = 9;
      for (int c = 0; c < 3; ++c) label = image->plane(c)[i] > 0.7f ? c : label;
      labels.push_back(label);
    }
    return labels;
  }
  LikelihoodForm Find(const std::vector<std::string>& paths, const LikelihoodForm& given = {}) {
    warnings_.clear();
    return FindLikelihoodForm(paths, kColors, given, &warnings_);
  }

  const std::string folder_ = FreshTestFolder("forms");
  Warnings warnings_;
};

TEST_F(LikelihoodFormsTest, ArraysOfAnyOrderAndTypeGiveTheSameValues) {
  const std::string files[] = {
      NpyText("<f4", "2, 3, 4", false, Stored(InOrder<float>("cyx"))),
      NpyText("<f8", "2, 3, 4", false, Stored(InOrder<double>("cyx"))),
      NpyText(">f4", "2, 3, 4", false, Stored(InOrder<float>("cyx"), true)),
      NpyText(">f8", "3, 4, 2", false, Stored(InOrder<double>("yxc"), true)),
      NpyText("<f4", "3, 4, 2", false, Stored(InOrder<float>("yxc"))),
      NpyText("<f4", "2, 3, 4", true, Stored(InOrder<float>("xyc"))),
      NpyText("<f4", "3, 4, 2", true, Stored(InOrder<float>("cxy"))),
      NpyText("<f4", "1, 2, 3, 4", false, Stored(InOrder<float>("cyx"))),
      NpyText("<f8", "1, 3, 4, 2", true, Stored(InOrder<double>("cxy"))),
  };
  for (const std::string& file : files) {
    const StatusOr<FloatImage> image = ReadLikelihoods(Write("a.npy", file), 2, SmallCamera());
    ASSERT_TRUE(image.ok()) << image.status();
    for (int y = 0; y < 3; ++y) {
      for (int x = 0; x < 4; ++x) EXPECT_EQ(image->at(x, y, 0), static_cast<float>(ValueAt(0, y, x))) << file;
    }
  }
  EXPECT_THAT(ErrorOf(Write("a.npy", files[4]), 5), HasSubstr("a.npy: header: found 2 classes, expected 5"));
}

TEST_F(LikelihoodFormsTest, WholeNumbersOfAnyTypeAreValues) {
  std::vector<int64_t> counts(24, 1);
  counts[12] = 3;  // class 1 of pixel (0, 0)
  const auto image =
      ReadLikelihoods(Write("a.npy", NpyText("<i8", "2, 3, 4", false, Stored(counts))), 2, SmallCamera());
  ASSERT_TRUE(image.ok()) << image.status();
  EXPECT_EQ(image->at(0, 0, 1), 0.75f);
}

TEST_F(LikelihoodFormsTest, TheStatedLayoutDecides) {
  LensModel square;
  square.pinhole = {2, 2, 10, 10, 1, 1};
  const std::string path = Write("a.npy", NpyText("<f4", "2, 2, 2", false, Stored<float>({1, 3, 0, 1, 0, 1, 1, 1})));
  LikelihoodForm form;
  EXPECT_EQ(ReadLikelihoods(path, 2, square, form)->at(0, 0, 0), 1);  // classes first
  form.layout = LikelihoodForm::Layout::kClassesLast;
  EXPECT_EQ(ReadLikelihoods(path, 2, square, form)->at(0, 0, 0), 0.25f);
}

TEST_F(LikelihoodFormsTest, LogitsAreReadIfTheFormSaysSo) {
  std::vector<float> logits(24, -2);
  logits[12] = static_cast<float>(std::log(3) - 2);
  const std::string path = Write("a.npy", NpyText("<f4", "2, 3, 4", false, Stored(logits)));
  EXPECT_THAT(ErrorOf(path, 2), AllOf(HasSubstr("class 0, pixel (0, 0): found -2"),
                                      HasSubstr("set \"likelihood_values\": \"logits\" in scene.json")));
  LikelihoodForm form;
  form.values = LikelihoodForm::Values::kLogits;
  const StatusOr<FloatImage> image = ReadLikelihoods(path, 2, SmallCamera(), form);
  ASSERT_TRUE(image.ok()) << image.status();
  EXPECT_NEAR(image->at(0, 0, 1), 0.75, 1e-6);
  EXPECT_NEAR(image->at(1, 0, 1), 0.5, 1e-6);
  logits[0] = NAN;
  Write("a.npy", NpyText("<f4", "2, 3, 4", false, Stored(logits)));
  EXPECT_THAT(ErrorOf(path, 2, form), HasSubstr("class 0, pixel (0, 0): found NaN"));
}

TEST_F(LikelihoodFormsTest, SumsOfPixelsAreMeasured) {
  std::vector<uint8_t> values(24, 60);
  std::fill(values.begin() + 12, values.end(), 140);
  values[0] = 115;
  const auto part = ReadLikelihoodPart(Write("a.npy", NpyText("|u1", "2, 3, 4", false, Stored(values))), 2,
                                       SmallCamera(), {0, 0, 4, 3});
  ASSERT_TRUE(part.ok()) << part.status();
  EXPECT_EQ(part->low_sum, 200);
  EXPECT_EQ(part->high_sum, 200);  // of 12 pixels one has 255
}

TEST_F(LikelihoodFormsTest, ArraysOfClassIds) {
  const std::vector<int> labels = {0, 1, 2, 0, 1, 2, 9, 9, 0, 0, 1, 2};
  const auto values = [&]<class Value>(Value unknown) {
    std::vector<Value> stored;
    for (const int label : labels) stored.push_back(label == 9 ? unknown : static_cast<Value>(label));
    return stored;
  };
  EXPECT_EQ(LabelsOf(Write("a.npy", NpyText("<i8", "3, 4", false, Stored(values(int64_t{-1}))))), labels);
  EXPECT_EQ(LabelsOf(Write("a.npy", NpyText(">i4", "3, 4", false, Stored(values(int32_t{255}), true)))), labels);
  EXPECT_EQ(LabelsOf(Write("a.npy", NpyText("|u1", "1, 3, 4", false, Stored(values(uint8_t{255}))))), labels);
  EXPECT_EQ(LabelsOf(Write("a.npy", NpyText("<u2", "3, 4, 1", false, Stored(values(uint16_t{255}))))), labels);
  std::vector<int64_t> wrong = values(int64_t{-1});
  wrong[6] = 3;
  const std::string path = Write("a.npy", NpyText("<i8", "3, 4", false, Stored(wrong)));
  EXPECT_THAT(ErrorOf(path, 3), AllOf(HasSubstr("a.npy: pixel (2, 1): found label 3, expected a class from 0 to 2"),
                                      HasSubstr("\"likelihood_first_id\": 1")));
  EXPECT_THAT(ErrorOf(Write("a.npy", NpyText("<f4", "3, 4", false, Stored(std::vector<float>(12)))), 3),
              HasSubstr("header: found two axes of floats"));
}

TEST_F(LikelihoodFormsTest, PalettesOfOtherColorsAreIds) {
  const std::vector<uint8_t> indices = {0, 1, 2, 0, 1, 2, 255, 255, 0, 0, 1, 2};
  const std::string path = WritePalette("a.png", indices, {{0, 0, 0}, {128, 0, 0}, {0, 128, 0}});
  const LikelihoodForm form = Find({path});
  EXPECT_EQ(form, LikelihoodForm());
  EXPECT_THAT(warnings_, ElementsAre(HasSubstr("1 label images with colours, such as 'a.png': the indices")));
  EXPECT_THAT(LabelsOf(path, form), ElementsAre(0, 1, 2, 0, 1, 2, 9, 9, 0, 0, 1, 2));
}

TEST_F(LikelihoodFormsTest, PalettesInTheColorsOfTheClassesDecide) {
  const std::string path =
      WritePalette("a.png", {0, 1, 2, 0, 1, 2, 3, 3, 0, 0, 1, 2}, {kColors[2], kColors[0], kColors[1], {0, 0, 0}});
  const LikelihoodForm form = Find({path});
  EXPECT_EQ(form.colors, kColors);
  EXPECT_THAT(LabelsOf(path, form), ElementsAre(2, 0, 1, 2, 0, 1, 9, 9, 2, 2, 0, 1));
}

TEST_F(LikelihoodFormsTest, ColorsOfTheClasses) {
  Colors pixels(12, kColors[1]);
  pixels[0] = kColors[2];
  pixels[1] = {0, 0, 0};
  const std::string path = WriteColors("a.png", pixels);
  LikelihoodForm form = Find({path});
  EXPECT_THAT(warnings_, ElementsAre(HasSubstr("the colours of the classes in scene.json decide")));
  EXPECT_THAT(LabelsOf(path, form), ElementsAre(2, 9, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1));
  pixels[7] = {1, 2, 3};
  form = Find({WriteColors("a.png", pixels)});
  EXPECT_THAT(ErrorOf(path, 3, form),
              HasSubstr("a.png: pixel (3, 1): found colour #010203, expected the \"color\" of a "
                        "class in scene.json (#808080, #800080, #e6be1e), or black"));
}

TEST_F(LikelihoodFormsTest, ColorsThatAreGreyLevelsOfIds) {
  Colors pixels(12, {1, 1, 1});
  pixels[3] = {2, 2, 2};
  pixels[4] = {255, 255, 255};
  const std::string path = WriteColors("a.png", pixels);
  const LikelihoodForm form = Find({path});
  EXPECT_EQ(form.colors, Colors());
  EXPECT_THAT(LabelsOf(path, form), ElementsAre(1, 1, 1, 2, 9, 1, 1, 1, 1, 1, 1, 1));
}

TEST_F(LikelihoodFormsTest, IdsCountFromOneIfTheHighestOfAllFilesIsTheNumberOfClasses) {
  ByteImage first(4, 3, 1, 1), second(4, 3, 1, 2);
  second.at(1, 0) = 3;
  const std::string a = folder_ + "/a.png", b = folder_ + "/b.png";
  ASSERT_TRUE(WritePng(a, first).ok() && WritePng(b, second).ok());
  const LikelihoodForm form = Find({a, b});
  EXPECT_EQ(form.first_id, 1);
  EXPECT_THAT(warnings_, ElementsAre(HasSubstr("class ids of label images count from 1")));
  EXPECT_THAT(LabelsOf(a, form), testing::Each(0));
  EXPECT_EQ(LabelsOf(b, form)[1], 2);
  first.at(2, 2) = 0;  // one pixel of 24: unknown
  ASSERT_TRUE(WritePng(a, first).ok());
  EXPECT_EQ(LabelsOf(a, Find({a, b}))[10], 9);
  for (int x = 0; x < 4; ++x) first.at(x, 0) = 0;  // a class of its own
  ASSERT_TRUE(WritePng(a, first).ok());
  EXPECT_EQ(Find({a, b}), LikelihoodForm());
  LikelihoodForm stated;
  stated.first_id = 1;
  EXPECT_EQ(Find({a, b}, stated), stated);
  EXPECT_THAT(warnings_, IsEmpty());
}

TEST_F(LikelihoodFormsTest, IdsWithoutZeroAreReported) {
  const std::string a = folder_ + "/a.png";
  ASSERT_TRUE(WritePng(a, ByteImage(4, 3, 1, 1)).ok());
  EXPECT_EQ(Find({a}), LikelihoodForm());
  EXPECT_THAT(warnings_, ElementsAre(HasSubstr("no label image has class id 0")));
  ASSERT_TRUE(WritePng(a, ByteImage(4, 3, 1, 0)).ok());
  EXPECT_EQ(Find({a, folder_ + "/missing.png"}), LikelihoodForm());
  EXPECT_THAT(warnings_, IsEmpty());
}

}  // namespace
}  // namespace tessera
