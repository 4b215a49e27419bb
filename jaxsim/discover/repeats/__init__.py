"""What repeats in sensor coordinates: residuals that come back in every scene at the same rows or columns.

Whatever is fixed in the sensor shows there, whatever its law; where no effect of the catalogue explains it, an answer
may not be *none*. Letters: n scenes, r rows, c columns, k places or periods of a scale.

    Maps           a channel's residuals, summed by scene on the polar grid (`maps`)
    maps_of        those of a fitted problem
    scales         the places and periods at which they are looked at (`maps`)
    find_repeats   what repeats on find scenes by chance of `Rules.repeats_level`, holds on judge scenes, and how large
                   it is in all of them (`find`)
    learn          these laws, fitted to the find scenes
    examine        all of this of a comparison, once what was named is in place; what it makes of an answer; and the
                   closed formula of one that has one

Of a mixed model with covariance V, V^-1 (y - X b) is R^-1 times the residual that is left once levels and poses are
taken out. So sums of weight times residual are the efficient score of a pattern, though levels of strips take up most
of what differs between columns; the size follows from what the same levels leave of a made pattern (`Maps.response`).
"""
