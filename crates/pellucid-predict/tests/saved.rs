//! Settings, identities and what was learned survive being saved.

use pellucid_predict::{Correction, Identity, InstructionSet, Learned, Sharing, WeightsIdentity};

fn there_and_back<T: serde::Serialize + serde::de::DeserializeOwned>(value: &T) -> T {
    serde_json::from_str(&serde_json::to_string(value).unwrap()).unwrap()
}

#[test]
fn nothing_changes_on_the_way() {
    let mut values: Vec<f64> =
        (1..2000).map(|i| f64::from_bits(0x0123_4567_89ab_cdef_u64.wrapping_mul(i))).collect();
    values.retain(|v| v.is_finite());
    assert!(values.len() > 1000);
    let singles = values.iter().map(|&v| v as f32).filter(|v| v.is_finite()).collect();
    let learned = Learned { predictor: "rpnn+mc".into(), passes: vec![0, 1, u32::MAX], values, singles };
    let back = there_and_back(&learned);
    let bits = |l: &Learned| l.values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&back), bits(&learned));
    assert_eq!(back, learned);

    let weights =
        WeightsIdentity { digest: "0f".into(), variant: "L+O".into(), history: vec!["trained".into()] };
    let identity =
        Identity::new("rpnn", InstructionSet::Avx512, false).with("precision", "bf16").with_weights(weights);
    assert_eq!(there_and_back(&identity), identity);

    let correction = Correction { one_in: 7, radius_mm: 0.1, memory: 0.3 };
    assert_eq!(there_and_back(&correction), correction);
    let sharing = Sharing { spacing_mm: 0.3, fine_levels: 2, coarse_mm: 1.5 };
    assert_eq!(there_and_back(&sharing), sharing);
}

#[test]
fn a_setting_that_is_left_out_is_the_default_and_an_unknown_one_is_refused() {
    let some: Correction = serde_json::from_str(r#"{"one_in": 9}"#).unwrap();
    assert_eq!(some, Correction { one_in: 9, ..Correction::default() });
    assert!(
        serde_json::from_str::<Correction>(r#"{"one_on": 9}"#).unwrap_err().to_string().contains("one_on")
    );
}
