"""Whether a named effect acts everywhere, or in a part of the recording: a regime.

Letters: b blocks, a sectors of azimuth, n scenes (or sectors of few drives), k regions of a question, c candidates.
In the order in which to read it:

    find_regimes    asks, fits, and puts effects in their regions (`find`)
    cells_of        how strongly every scene and sector asks for an effect (`cells`)
    questions       what may divide it: moments, tags, sectors (`questions`)
    ranked          the regions worth looking at, of effects that are named or of candidates (`leads`)
    best_region     exact tests over scenes, the best of all regions (`chance`)
    confine         the effect fitted in its region, and whether another is the better name there (`confine`)
    sized           how large it is there, and outside (`sizes`)
    JudgeScenes     whether scenes that nothing was fitted to gain by it (`judge`)
    regime_of       the verdict's entry (`find`)
"""
