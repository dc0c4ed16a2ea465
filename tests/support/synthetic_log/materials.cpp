// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_log/materials.h"

#include <algorithm>

namespace stillmap::synthetic {

namespace {

// No surface of the room comes near a safety vest's yellow-green, as no sensible warehouse paints its walls
// so.
constexpr Rgb kInks[] = {{25, 25, 30},   {150, 30, 35}, {30, 60, 140},
                         {215, 120, 40}, {20, 90, 95},  {110, 50, 120}};
constexpr Rgb kPapers[] = {{225, 220, 205}, {180, 200, 220}, {215, 175, 165},
                           {160, 165, 170}, {120, 150, 175}, {200, 160, 90}};

Rgb varied(Random& random, Rgb c, double amount) {
  return scaled(c, random.uniform(1 - amount, 1 + amount));
}

Texture brick(Random& random) {
  Texture t(1024, 512, {165, 158, 150});
  constexpr int kWidth = 64, kHeight = 32;
  for (int row = 0; row < 512 / kHeight; ++row) {
    for (int column = 0; column < 1024 / kWidth; ++column) {
      const int x = column * kWidth + (row % 2) * kWidth / 2, y = row * kHeight;
      t.rectangle(x + 2, y + 2, x + kWidth - 2, y + kHeight - 2, varied(random, {150, 85, 65}, 0.35));
    }
  }
  t.weather(random, 0.35, 128, 0.02);
  return t;
}

Texture plaster(Random& random) {
  Texture t(1024, 512, {188, 184, 172});
  for (int i = 0; i < 160; ++i) {  // chips, screws, scratches and old marks
    const int x = random.below(1024), y = random.below(512);
    const Rgb c = varied(random, {120, 115, 110}, 0.5);
    if (random.chance(0.5)) {
      t.disk(x, y, 1 + random.below(5), c);
    } else {
      const int high = random.below(5), wide = random.below(30);
      t.rectangle(x, y, x + 2 + wide, y + 1 + high, c);
    }
  }
  t.weather(random, 0.3, 256, 0.02);
  return t;
}

Texture floor(Random& random) {
  Texture t(1024, 1024, {95, 92, 88});
  constexpr int kTile = 128;
  for (int y = 0; y < 1024; y += kTile) {
    for (int x = 0; x < 1024; x += kTile) {
      t.rectangle(x + 2, y + 2, x + kTile - 2, y + kTile - 2, varied(random, {140, 136, 126}, 0.2));
    }
  }
  for (int i = 0; i < 300; ++i) {
    const Rgb c = varied(random, {100, 96, 90}, 0.5);
    const int radius = 1 + random.below(7), y = random.below(1024), x = random.below(1024);
    t.disk(x, y, radius, c);
  }
  t.weather(random, 0.3, 128, 0.05);
  return t;
}

Texture ceiling(Random& random) {
  Texture t(512, 512, {150, 150, 150});
  for (int y = 0; y < 512; y += 128) {
    for (int x = 0; x < 512; x += 128) {
      t.rectangle(x + 3, y + 3, x + 125, y + 125, varied(random, {205, 205, 200}, 0.08));
      for (int i = 0; i < 40; ++i) {
        const int down = random.below(114), right = random.below(114);
        t.disk(x + 6 + right, y + 6 + down, 1, {120, 120, 120});
      }
    }
  }
  t.weather(random, 0.1, 128, 0.01);
  return t;
}

Texture wood(Random& random) {
  Texture t(512, 512, {150, 108, 66});
  for (int board = 0; board < 512; board += 64) {
    const Rgb c = varied(random, {158, 112, 70}, 0.2);
    t.rectangle(0, board, 512, board + 62, c);
    for (int i = 0; i < 12; ++i) {
      const int y = board + random.below(60), x = random.below(512);
      const Rgb grain = scaled(c, random.uniform(0.6, 0.85));
      const int high = random.below(2), wide = random.below(200);
      t.rectangle(x, y, x + 60 + wide, y + 1 + high, grain);
    }
    for (int i = 0; i < 3; ++i) {
      const int x = random.below(512), y = board + 8 + random.below(46), r = 2 + random.below(6);
      t.disk(x, y, r + 2, scaled(c, 0.8));
      t.disk(x, y, r, scaled(c, 0.4));
    }
  }
  t.weather(random, 0.2, 64, 0.01);
  return t;
}

Texture carton(Random& random) {
  Texture t(512, 512, {172, 132, 88});
  t.rectangle(0, 240, 512, 272, {150, 120, 84});  // tape
  for (int i = 0; i < 8; ++i) {
    const int x = 20 + random.below(400), y = 20 + random.below(400), w = 50 + random.below(70),
              h = 30 + random.below(50);
    t.rectangle(x, y, x + w, y + h, kPapers[random.below(6)]);
    const Rgb ink = kInks[random.below(6)];
    t.print(random, x + 4, y + 4, x + w - 4, y + h - 4, 6 + random.below(6), ink);
  }
  for (int i = 0; i < 6; ++i) {
    const int x = random.below(460), y = random.below(460);
    t.print(random, x, y, x + 90, y + 26, 16, {70, 48, 34});
  }
  t.weather(random, 0.2, 64, 0.02);
  return t;
}

Texture metal(Random& random) {
  Texture t(512, 512, {105, 115, 125});
  for (int y = 0; y < 512; y += 128) {
    for (int x = 0; x < 512; x += 256) {
      t.rectangle(x + 3, y + 3, x + 253, y + 125, varied(random, {125, 138, 150}, 0.15));
      t.rectangle(x + 98, y + 88, x + 158, y + 100, {45, 48, 52});
      t.rectangle(x + 90, y + 30, x + 166, y + 66, {220, 218, 205});
      t.print(random, x + 94, y + 34, x + 162, y + 62, 8, {30, 30, 40});
      for (int i = 0; i < 4; ++i) t.disk(x + 12 + (i % 2) * 232, y + 12 + (i / 2) * 104, 3, {60, 64, 70});
    }
  }
  for (int i = 0; i < 60; ++i) {
    const int x = random.below(512), y = random.below(512);
    t.rectangle(x, y, x + 3 + random.below(24), y + 1, {165, 170, 175});
  }
  t.weather(random, 0.2, 64, 0.02);
  return t;
}

Texture books(Random& random) {
  Texture t(1024, 128, {30, 26, 24});
  for (int x = 0; x < 1024;) {
    const int w = std::min(8 + random.below(22), 1024 - x), top = random.below(30);
    const Rgb c =
        varied(random, random.chance(0.5) ? kInks[random.below(6)] : kPapers[random.below(6)], 0.25);
    t.rectangle(x, top, x + w - 1, 128, c);
    const Rgb label = kPapers[random.below(6)];
    const int band = top + 12 + random.below(50);
    t.rectangle(x + 1, band, x + w - 2, band + 6 + random.below(16), label);
    t.print(random, x + 1, top + 4, x + w - 1, band, 5, label);
    x += w;
  }
  t.weather(random, 0.15, 32, 0.01);
  return t;
}

Texture screen(Random& random) {
  Texture t(256, 256, {22, 26, 36});
  for (int i = 0; i < 9; ++i) {
    const int x = random.below(180), y = random.below(180), w = 40 + random.below(70),
              h = 30 + random.below(60);
    t.rectangle(x, y, x + w, y + h, varied(random, kPapers[random.below(6)], 0.3));
    t.print(random, x + 3, y + 8, x + w - 3, y + h - 3, 6, kInks[random.below(6)]);
  }
  return t;
}

Texture hazard() {
  Texture t(128, 128, {40, 38, 36});
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 128; ++x) {
      if ((x + y) % 64 < 32) t.set(x, y, {196, 150, 40});
    }
  }
  return t;
}

/// Once round the body by once from hips (v = 0) to shoulders. The front is at u = 128 (and the back at 0).
Texture vest(Random& random) {
  Texture t(256, 128, {196, 236, 36});
  const Rgb silver{200, 202, 205}, seam{120, 150, 30};
  t.weather(random, 0.16, 32, 0.01);
  for (int y : {26, 62}) {
    t.rectangle(0, y - 1, 256, y + 13, seam);
    t.rectangle(0, y, 256, y + 12, silver);
  }
  for (int x : {-24, 24, 104, 152}) t.rectangle(x - 6, 74, x + 6, 128, silver);
  t.rectangle(127, 0, 129, 128, {70, 80, 30});
  t.rectangle(100, 90, 118, 104, {60, 66, 70});  // badge
  return t;
}

Texture cloth(Random& random, Rgb base, bool stripes) {
  Texture t(128, 128, base);
  for (int i = 0; i < 26; ++i) {  // folds, seams and pockets
    const int x = random.below(128), y = random.below(128);
    const Rgb c = scaled(base, random.uniform(0.5, 1.5));
    const int high = random.below(4), wide = random.below(24);
    t.rectangle(x, y, x + 3 + wide, y + 1 + high, c);
  }
  if (stripes) t.rectangle(0, 40, 128, 54, {190, 192, 196});
  t.weather(random, 0.4, 32, 0.1);
  return t;
}

Texture poster(Random& random) {
  Texture t(256, 256, varied(random, kPapers[random.below(6)], 0.1));
  for (int i = 0; i < 7; ++i) {
    const int x = random.below(200), y = random.below(200), s = 16 + random.below(70);
    const Rgb c = varied(random, kInks[random.below(6)], 0.3);
    switch (random.below(4)) {
      case 0:
        t.rectangle(x, y, std::min(x + s, 255), std::min(y + s / 2, 255), c);
        break;
      case 1:
        t.disk(std::clamp(x, s / 2, 255 - s / 2), std::clamp(y, s / 2, 255 - s / 2), s / 2, c);
        break;
      case 2:
        t.print(random, x, y, std::min(x + 2 * s, 250), std::min(y + s, 250), 6 + random.below(14), c);
        break;
      default:  // a coded marker
        for (int cell = 0; cell < 64; ++cell) {
          const int px = x + (cell % 8) * 6, py = y + (cell / 8) * 6;
          t.rectangle(px, py, px + 6, py + 6, random.chance(0.5) ? Rgb{15, 15, 15} : Rgb{235, 235, 235});
        }
    }
  }
  t.rectangle(0, 0, 256, 4, {50, 45, 40});
  t.rectangle(0, 252, 256, 256, {50, 45, 40});
  t.rectangle(0, 0, 4, 256, {50, 45, 40});
  t.rectangle(252, 0, 256, 256, {50, 45, 40});
  t.weather(random, 0.08, 64, 0.005);
  return t;
}

}  // namespace

std::vector<Texture> make_materials(std::uint64_t seed) {
  Random random(seed, 1);
  std::vector<Texture> all;
  all.reserve(kPoster + kPosters);
  all.push_back(brick(random));
  all.push_back(plaster(random));
  all.push_back(floor(random));
  all.push_back(ceiling(random));
  all.push_back(wood(random));
  all.push_back(carton(random));
  all.push_back(metal(random));
  all.push_back(books(random));
  all.push_back(screen(random));
  all.push_back(hazard());
  all.push_back(vest(random));
  all.push_back(cloth(random, {52, 60, 88}, true));
  all.push_back(cloth(random, {88, 80, 84}, false));
  all.push_back(cloth(random, {196, 148, 120}, false));
  all.push_back(cloth(random, {205, 205, 210}, false));
  all.push_back(cloth(random, {52, 42, 36}, false));
  for (int i = 0; i < kPosters; ++i) all.push_back(poster(random));
  for (Texture& texture : all) texture.finish();
  return all;
}

}  // namespace stillmap::synthetic
